"""Voyages of invented boats with something hidden, as MAVLink logs.

The physics here shares no code with `sim`, and its forms differ where nature's would: what
diagnoses these voyages has nothing to recognise but the physics. From the inside out: `boats`,
`hull` and `nature` (the truth), `causes` (what can be hidden), `pilots` and `missions` (who
steers), `sail` (time passes), `sensors` (what the autopilot believes), `telemetry` and `link`
(what it says and what arrives), `voyage` (all of it, one file).
"""
