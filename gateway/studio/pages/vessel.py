"""Vessel: its numbers with intervals, moved by sliders while the comparison follows."""

import tomllib
from functools import partial
from html import escape
from io import StringIO
from typing import Any

import panel as pn

from gateway.figures.motion import with_earlier_model
from gateway.studio.controls import FigurePlace, SaveControls, error_table
from gateway.studio.page import (
    STYLE,
    Page,
    StudioContext,
    Watches,
    card,
    download,
    html,
    section,
    side_by_side,
    stack,
    word,
)
from gateway.studio.session import with_values
from gateway.user_effects import known_effects

BASE = {  # unit and meaning of the plain numbers
    "m11": ("kg", "mass ahead, with the water that moves along"),
    "m22": ("kg", "mass sideways, with water"),
    "m33": ("kg m²", "resistance to turning faster"),
    "X_u": ("N s/m", "drag ahead"),
    "X_uu": ("N s²/m²", "drag ahead, squared"),
    "Y_v": ("N s/m", "drag sideways"),
    "Y_vv": ("N s²/m²", "drag sideways, squared"),
    "N_r": ("N m s", "drag of turning"),
    "N_rr": ("N m s²", "drag of turning, squared"),
}


class VesselPage(Page):
    """Numbers, and what they do."""

    def __init__(self, context: StudioContext) -> None:
        super().__init__(context)
        self._sliders: dict[str, Any] = {}
        self._origins: dict[str, Any] = {}
        self._quiet = False
        self._numbers = stack()
        self._errors, self._text, self._head = html(), html(), html()
        self._velocities = FigurePlace(self.view, min_height=540)
        export = download("Download", "vessel.toml", self._file, width=120)
        self._save = SaveControls(self, "Save as", "changed", export, widths=(220, 180),
                                  kind="primary")  # fmt: skip

    def body(self) -> Any:
        """Numbers left, their effect right; below it the file."""
        interval = word("95 % interval")
        hint = html(f"<p class='faint'>Below a number its {interval}, where it was fitted.</p>")
        left = card(self._head, self._save.part, hint, self._numbers)
        three = f"{word('surge u')}, {word('sway v')}, {word('yaw rate r')}"
        right = section("What it does", f"To {three}; the error is the {word('nrmse')}.",
                        self._errors, self._velocities.part)  # fmt: skip
        return stack(side_by_side(left, right), card(self._text))

    def watch(self) -> Watches:
        """The vessel, and what was compared."""
        return {
            ("vessel",): self._show_vessel,
            ("trials", "vessel"): self._show_trials,
        }

    def _show_vessel(self) -> None:
        version = self.session.version
        if version is None:
            self._head.object = "<h1>No vessel yet</h1><p>Choose one under Recordings.</p>"
            return
        tables = tomllib.loads(version.text)
        self._head.object = (
            f"<h1>{escape(tables['name'])}</h1><p class='faint'>{escape(tables.get('source', ''))}"
            f"</p><p class='faint'>{escape(version.change)}</p>"
        )
        self._text.object = (
            f"<details><summary>The file</summary><pre>{escape(version.text)}</pre></details>"
        )
        self._save.update()
        self._move_sliders(tables)

    def _move_sliders(self, tables: dict[str, Any]) -> None:
        """Sliders for the numbers there are; those that are there move without an echo."""
        numbers = _numbers(tables)
        if set(numbers) != set(self._sliders):
            self._sliders = {key: self._slider(key, *row) for key, row in numbers.items()}
            self._origins = {key: html() for key in numbers}
            self._numbers.objects = [
                part for key in numbers for part in (self._sliders[key], self._origins[key])
            ]
        self._quiet = True
        for key, (value, low, high, _) in numbers.items():
            slider = self._sliders[key]
            if slider.value != value:
                slider.param.update(
                    start=min(slider.start, low, value), end=max(slider.end, high, value),
                    value=value,
                )  # fmt: skip
            self._origins[key].object = _origin(tables, key)
        self._quiet = False

    def _slider(self, key: str, value: float, low: float, high: float, unit: str) -> Any:
        name = key.replace("_", " ").replace(".", ": ")
        label = f"{key}: {BASE[key][1]}" if key in BASE else name
        made = pn.widgets.FloatSlider(
            label=f"{label} [{unit}]",
            start=low, end=high, value=value, step=(high - low) / 400.0, format="0.0000",
            stylesheets=[STYLE], sizing_mode="stretch_width", margin=(6, 10, 0, 10),
        )  # fmt: skip
        made.param.watch(lambda event: self.caught(partial(self._slid, key, event.new)), "value")
        return made

    def _slid(self, key: str, value: float) -> None:
        if self._quiet or self.session.version is None:
            return
        text = with_values(self.session.version, {key: value})
        self.session.slide(text, f"{key} moved by hand")

    def _show_trials(self) -> None:
        compared = [trial for trial in self.session.trials if trial.vessels]
        self._errors.object = error_table("recording", compared, self.session.is_current)
        if not compared and self.session.refused:
            reasons = " ".join(map(escape, self.session.refused.values()))
            self._errors.object = f"<p class='warn'>Not compared: {reasons}</p>"
        if compared:
            given, now = compared[0].vessels[0].figures, compared[0].vessels[-1].figures
            self._velocities.show(with_earlier_model(given["velocities"], now["velocities"]))

    def _file(self) -> StringIO:
        return StringIO(self.session.version.text if self.session.version else "")


def _numbers(tables: dict[str, Any]) -> dict[str, tuple[float, float, float, str]]:
    """Key -> value, where the slider begins and ends, unit."""
    out = {}
    for name, (unit, _) in BASE.items():
        value = float(tables["dynamics"][name])
        reach = max(abs(value), 1.0)
        low, high = (0.3 * value, 2.0 * value) if value > 0 else (value - reach, 0.0)
        out[name] = value, low, high, unit
    known = {effect.name: effect for effect in known_effects()}
    for entry in tables.get("effects", []):
        effect = known.get(entry["type"])
        for p in effect.parameters if effect else ():
            if p.name in entry:
                out[f"{entry['type']}.{p.name}"] = entry[p.name], p.lower, p.upper, p.unit or "–"
    return out


def _origin(tables: dict[str, Any], key: str) -> str:
    """Where a number came from, with its interval."""
    name = key if "." in key else f"dynamics.{key}"
    origin = tables.get("provenance", {}).get(name)
    if not origin:
        return ""
    low, high = origin.get("ci95", (None, None))
    interval = f"95 %: {low:.4g} … {high:.4g}; " if low is not None else ""
    source = f"{origin.get('recording', '')} {origin.get('date', '')}".strip()
    return f"<p class='faint'>{interval}{escape(source)} {escape(origin.get('says', ''))}</p>"
