"""The boat that an autopilot drives: pulses in, motion of six degrees and sensor readings out."""
