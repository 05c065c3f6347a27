"""Vessel: its numbers with intervals, moved by sliders while the comparison follows."""

import tomllib
from collections.abc import Callable
from functools import partial
from html import escape
from io import StringIO
from typing import Any

import panel as pn

from gateway.figures.bokeh_draw import BokehFigure
from gateway.figures.motion import with_earlier_model
from gateway.studio.page import Page
from gateway.studio.session import Session, as_text
from gateway.studio.widgets import (
    STYLE,
    beside,
    button,
    card,
    controls,
    download,
    field,
    html,
    table,
    word,
)
from gateway.user_effects import known_effects

UNITS = {
    "m11": "kg", "m22": "kg", "m33": "kg m²", "X_u": "N s/m", "X_uu": "N s²/m²",
    "Y_v": "N s/m", "Y_vv": "N s²/m²", "N_r": "N m s", "N_rr": "N m s²",
}  # fmt: skip
SAYS = {
    "m11": "mass ahead, with the water that moves along", "m22": "mass sideways, with water",
    "m33": "resistance to turning faster", "X_u": "drag ahead", "X_uu": "drag ahead, squared",
    "Y_v": "drag sideways", "Y_vv": "drag sideways, squared", "N_r": "drag of turning",
    "N_rr": "drag of turning, squared",
}  # fmt: skip


class VesselPage(Page):
    """Numbers, and what they do."""

    name, title = "vessel", "Vessel"

    def __init__(self, desk: Session) -> None:
        super().__init__(desk)
        self._sliders: dict[str, Any] = {}
        self._told: dict[str, Any] = {}
        self._quiet = False
        self._numbers = pn.Column(sizing_mode="stretch_width")
        self._errors, self._text, self._head = html(), html(), html()
        self._place = pn.Column(sizing_mode="stretch_width", min_height=540)
        self._pictures: dict[str, BokehFigure] = {}
        self._undo = button("Undo", self.safely(desk.undo), width=90)
        self._name = field("Save as", width=220)
        self._save = button("Save vessel file", self.safely(self._saved), "primary", width=180)
        self._export = download("Download", "vessel.toml", self._file, width=120)

    def body(self) -> Any:
        """Numbers left, their effect right; below it the file."""
        keep = controls(self._undo, self._name, self._save, self._export)
        hint = html(f"<p class='faint'>Below a number its {word('95 % interval')}, where it was "
                    "fitted.</p>")  # fmt: skip
        left = card(self._head, keep, hint, self._numbers)
        three = f"{word('surge u')}, {word('sway v')}, {word('yaw rate r')}"
        right = card(html(f"<h2>What it does</h2><p class='faint'>To {three}; the error is the "
                          f"{word('nrmse')}.</p>"), self._errors, self._place)  # fmt: skip
        return pn.Column(beside(left, right), card(self._text), sizing_mode="stretch_width")

    def watch(self) -> dict[tuple[str, ...], Callable[[], None]]:
        """The vessel, and what was compared."""
        return {("vessel",): self._shown, ("trials",): self._compared}

    def _shown(self) -> None:
        version = self.desk.version
        if version is None:
            self._head.object = "<h1>No vessel yet</h1><p>Choose one under Recordings.</p>"
            return
        tables = tomllib.loads(version.text)
        self._head.object = (
            f"<h1>{escape(tables['name'])}</h1><p class='faint'>{escape(tables.get('source', ''))}"
            f"</p><p class='faint'>{escape(version.what)}</p>"
        )
        self._undo.disabled = len(self.desk.versions) < 2
        self._text.object = (
            f"<details><summary>The file</summary><pre>{escape(version.text)}</pre></details>"
        )
        if self.desk.vessel_file is not None and not self._name.value:
            self._name.value = f"{self.desk.vessel_file.stem}-changed.toml"
        self._slide_to(tables)

    def _slide_to(self, tables: dict[str, Any]) -> None:
        """Sliders for the numbers there are; those that are there move without an echo."""
        numbers = _numbers(tables)
        if set(numbers) != set(self._sliders):
            self._sliders = {key: self._slider(key, *row) for key, row in numbers.items()}
            self._told = {key: html() for key in numbers}
            self._numbers.objects = [
                part for key in numbers for part in (self._sliders[key], self._told[key])
            ]
        self._quiet = True
        for key, (value, low, high, _) in numbers.items():
            slider = self._sliders[key]
            if slider.value != value:
                slider.param.update(
                    start=min(slider.start, low, value), end=max(slider.end, high, value),
                    value=value,
                )  # fmt: skip
            self._told[key].object = _origin(tables, key)
        self._quiet = False

    def _slider(self, key: str, value: float, low: float, high: float, unit: str) -> Any:
        made = pn.widgets.FloatSlider(
            label=f"{_label(key)} [{unit}]", start=low, end=high, value=value,
            step=(high - low) / 400.0, format="0.0000", stylesheets=[STYLE],
            sizing_mode="stretch_width", margin=(6, 10, 0, 10),
        )  # fmt: skip
        made.param.watch(lambda event: self.safely(partial(self._slid, key, event.new))(), "value")
        return made

    def _slid(self, key: str, value: float) -> None:
        if self._quiet or self.desk.version is None:
            return
        self.desk.slide(as_text(self.desk.version, {key: value}), f"{key} moved by hand")

    def _compared(self) -> None:
        rows = [
            [escape(t.name), f"{t.vessels[0].nrmse:.3f}", f"{t.vessels[-1].nrmse:.3f}",
             f"{t.vessels[0].floor:.3f}"] for t in self.desk.trials if t.vessels
        ]  # fmt: skip
        heads = ["recording", "error as given", "error now", word("noise floor")]
        self._errors.object = table(heads, rows)
        trial = next((t for t in self.desk.trials if t.vessels), None)
        if trial is not None:
            first, last = trial.vessels[0].pictures, trial.vessels[-1].pictures
            data = with_earlier_model(first["velocities"], last["velocities"])
            self.fill(self._place, data, self._pictures, "velocities")

    def _saved(self) -> None:
        self.desk.say(f"saved: {self.desk.save(self._name.value.strip())}", good=True)

    def _file(self) -> StringIO:
        return StringIO(self.desk.version.text if self.desk.version else "")


def _numbers(tables: dict[str, Any]) -> dict[str, tuple[float, float, float, str]]:
    """Key -> value, where the slider begins and ends, unit."""
    out = {}
    for name, unit in UNITS.items():
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


def _label(key: str) -> str:
    return f"{key}: {SAYS[key]}" if key in SAYS else key.replace("_", " ").replace(".", ": ")


def _origin(tables: dict[str, Any], key: str) -> str:
    """Where a number came from, with its interval."""
    name = key if "." in key else f"dynamics.{key}"
    told = tables.get("provenance", {}).get(name)
    if not told:
        return ""
    low, high = told.get("ci95", (None, None))
    interval = f"95 %: {low:.4g} … {high:.4g}; " if low is not None else ""
    source = f"{told.get('recording', '')} {told.get('date', '')}".strip()
    return f"<p class='faint'>{interval}{escape(source)} {escape(told.get('says', ''))}</p>"
