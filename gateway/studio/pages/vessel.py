"""Vessel: its numbers with intervals, moved by sliders while the comparison follows."""

import math
import tomllib
from functools import partial
from html import escape
from io import StringIO
from pathlib import Path
from typing import Any, NamedTuple

import panel as pn

from gateway.errors import ShadowError
from gateway.figures import peoples_unit
from gateway.figures.motion import with_earlier_model
from gateway.studio import tasks
from gateway.studio.controls import FigurePlace, LearnFrom, SaveControls, error_table
from gateway.studio.page import (
    FIXED,
    NO_BUTTON,
    STYLE,
    Page,
    StudioContext,
    Watches,
    button,
    card,
    download,
    html,
    section,
    side_by_side,
    stack,
    word,
)
from gateway.studio.session import Session
from gateway.studio.time_marks import ScopeLine
from gateway.studio.version import with_values
from gateway.user_effects import known_effects
from sim.effects.effect import LawError

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
DOWNLOADED = "vessel.toml"


class Number(NamedTuple):
    """A number of the vessel in the unit that is shown, where its slider begins and ends, and SI of
    one such unit."""

    value: float
    low: float
    high: float
    unit: str
    si: float


class VesselPage(Page):
    """Numbers, and what they do."""

    def __init__(self, context: StudioContext) -> None:
        super().__init__(context)
        self._sliders: dict[str, Any] = {}
        self._typed: dict[str, Any] = {}
        self._resets: dict[str, Any] = {}
        self._origins: dict[str, Any] = {}
        self._quiet = False
        self._numbers = stack()
        self._errors, self._text, self._head, self._done = html(), html(), html(), html()
        self._scope, self._learn = ScopeLine(self.session), LearnFrom(self)
        self._fit = button("Fit the base numbers", self.guarded(self._start_fit), width=200)
        self._velocities = FigurePlace(self.view, min_height=540)
        export = download("Download", DOWNLOADED, self._file, width=120)
        self._save = SaveControls(self, "Save as", "changed", export, widths=(220, 180),
                                  kind="primary")  # fmt: skip

    def body(self) -> Any:
        """Numbers left, their effect right; below it the file."""
        interval = word("95 % interval")
        hint = html(f"<p class='faint'>Below a number its {interval}, where it was fitted.</p>")
        fit = section("Fit", f"Learn the nine numbers of the {word('base')} from these recordings; "
                      "what is marked on Compare can be left out or used alone.", self._scope.part,
                      self._learn.part, self._fit)  # fmt: skip
        left = stack(card(self._head, self._save.part, self._done, hint, self._numbers), fit)
        three = f"{word('surge u')}, {word('sway v')}, {word('yaw rate r')}"
        right = section("What it does", f"To {three}; the error is the {word('nrmse')}.",
                        self._errors, self._velocities.part)  # fmt: skip
        return stack(side_by_side(left, right), card(self._text))

    def watch(self) -> Watches:
        """The vessel, and what was compared."""
        return {
            ("vessel",): self._show_vessel,
            ("logs",): self._learn.update,
            ("scope",): self._scope.update,
            ("trials", "vessel"): self._show_trials,
        }

    def tick(self) -> None:
        """One fit at a time."""
        if self._fit.disabled != self.session.slow.busy:
            self._fit.disabled = self.session.slow.busy

    def _start_fit(self) -> None:
        self._learn.check()
        self.session.fit()

    def _show_vessel(self) -> None:
        version = self.session.version
        if version is None:
            self._head.object = "<h1>No vessel yet</h1><p>Choose one under Recordings.</p>"
            return
        tables = tomllib.loads(version.text)
        self._head.object = (
            f"<h1>{escape(tables['name'])}</h1><p class='faint'>{escape(tables.get('source', ''))}"
            "</p>"
        )
        self._done.object = history_text(self.session)
        self._text.object = (
            f"<details><summary>The file</summary><pre>{escape(self.session.to_save().text)}</pre>"
            "</details>"
        )
        self._save.update()
        self._move_sliders(tables)

    def _move_sliders(self, tables: dict[str, Any]) -> None:
        """Controls for the numbers there are; those that are there move without an echo."""
        numbers, given = (
            numbers_of(tables),
            numbers_of(tomllib.loads(self.session.versions[0].text)),
        )
        if set(numbers) != set(self._sliders):
            self._origins = {key: html() for key in numbers}
            self._numbers.objects = [
                part for key, one in numbers.items()
                for part in (self._row(key, one), self._origins[key])
            ]  # fmt: skip
        self._quiet = True
        for key, one in numbers.items():
            slider = self._sliders[key]
            if slider.value != one.value:
                slider.param.update(
                    start=min(slider.start, one.low, one.value),
                    end=max(slider.end, one.high, one.value), value=one.value,
                )  # fmt: skip
            self._typed[key].value = float(f"{one.value:.6g}")
            same = key not in given or math.isclose(given[key].value, one.value, rel_tol=1e-9)
            self._resets[key].disabled = same
            self._origins[key].object = _origin(tables, key, one)
        self._quiet = False

    def _row(self, key: str, one: Number) -> Any:
        """A number: typed, moved, and put back to what it was given as."""
        name = key.replace("_", " ").replace(".", ": ") if "." in key else key
        typed = pn.widgets.FloatInput(label=f"{name} [{one.unit}]", value=one.value, width=150,
                                      format="0.[000000]", **FIXED)  # fmt: skip
        slider = pn.widgets.FloatSlider(
            label=BASE[key][1] if key in BASE else f"{name}, moved", start=one.low, end=one.high,
            value=one.value, step=(one.high - one.low) / 400.0, show_value=False,
            stylesheets=[STYLE], sizing_mode="stretch_width", margin=(6, 14, 0, 14),
        )  # fmt: skip
        reset = button(f"Reset {name}", self.guarded(partial(self._reset, key)), width=130)
        for widget in (typed, slider):
            widget.param.watch(partial(self._moved, key, one.si), "value")
        slider.styles = {"flex": "1 1 140px", "min-width": "140px"}
        self._typed[key], self._sliders[key], self._resets[key] = typed, slider, reset
        row = {
            "flex-direction": "row", "flex-wrap": "wrap", "align-items": "flex-end", "gap": "4px"
        }  # fmt: skip
        return stack(typed, slider, reset, styles=row, stylesheets=[NO_BUTTON], margin=0)

    def _moved(self, key: str, si: float, event: Any) -> None:
        if not self._quiet and event.new is not None:
            self.caught(partial(self._slid, key, event.new * si, "changed"))

    def _reset(self, key: str) -> None:
        given = numbers_of(tomllib.loads(self.session.versions[0].text))[key]
        self._slid(key, given.value * given.si, "as given")

    def _slid(self, key: str, value: float, how: str) -> None:
        if self.session.version is not None:
            text = with_values(self.session.version, {key: value})
            try:
                tasks.vessel_of(text, tasks.effects_in(self.session.effect_files))
            except (ShadowError, LawError):  # what is refused does not stay as if it were taken
                self._move_sliders(tomllib.loads(self.session.version.text))
                raise
            self.session.slide(text, f"{key} {how}")

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
        """The vessel file, and on the page what has to be put beside it."""
        if self.session.version is None:
            return StringIO()
        made = self.session.to_save()
        files = " and ".join(
            f"{Path(one.path).resolve()}{'' if Path(one.path).name == name else f' as {name}'}"
            for name, one in made.beside.items()
        )
        if files:
            self.notify(f"{DOWNLOADED} names its own effects: put a copy of {files} beside it"
                        f"{made.to_trust(DOWNLOADED)}")  # fmt: skip
        return StringIO(made.text)


def history_text(session: Session) -> str:
    """Changes of the vessel in order, as HTML: first the file it was given as, last the latest;
    what was undone and can be done again is fainter."""
    done = [escape(one.change) for one in session.versions]
    done[-1] = f"<strong>{done[-1]}</strong>"
    again = [f"<span class='faint'>{escape(one.change)}</span>" for one in session.undone[::-1]]
    return f"<p>{' → '.join([*done, *again])}</p>"


def numbers_of(tables: dict[str, Any]) -> dict[str, Number]:
    """The numbers of a vessel file by key, as they are shown."""
    out = {}
    for name, (unit, _) in BASE.items():
        value = float(tables["dynamics"][name])
        reach = max(abs(value), 1.0)
        low, high = (0.3 * value, 2.0 * value) if value > 0 else (value - reach, 0.0)
        out[name] = Number(value, low, high, unit, 1.0)
    known = {effect.name: effect for effect in known_effects()}
    for entry in tables.get("effects", []):
        effect = known.get(entry["type"])
        for p in effect.parameters if effect else ():
            if p.name in entry:
                unit, many = peoples_unit(p.unit)
                out[f"{entry['type']}.{p.name}"] = Number(
                    entry[p.name] * many, p.lower * many, p.upper * many, unit, 1.0 / many
                )
    return out


def _origin(tables: dict[str, Any], key: str, one: Number) -> str:
    """Where a number came from, with its interval in the unit that is shown."""
    name = key if "." in key else f"dynamics.{key}"
    origin = tables.get("provenance", {}).get(name)
    if not origin:
        return ""
    low, high = origin.get("ci95", (None, None))
    interval = f"95 %: {low / one.si:.4g} … {high / one.si:.4g}; " if low is not None else ""
    source = f"{origin.get('recording', '')} {origin.get('date', '')}".strip()
    return f"<p class='faint'>{interval}{escape(source)} {escape(origin.get('says', ''))}</p>"
