"""The few kinds of parts that pages are made of, in one style.

A page open in one browser: its theme, its view of the session, what it does on a change.

Pages have no threads. Each looks at the session a few times a second on the server's own loop and
draws what has another revision than what it drew last.
"""

import re
import time
import traceback
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from dataclasses import field as dataclass_field
from html import escape
from pathlib import Path
from sys import stderr
from typing import Any, ClassVar

import panel as pn

from gateway.config import StudioSettings
from gateway.errors import ShadowError
from gateway.figures import LIGHT, THEMES
from gateway.figures.bokeh_draw import LinkedView
from gateway.figures.html_report import GLOSSARY
from gateway.studio import Address
from gateway.studio.live_history import LiveHistory
from gateway.studio.names import labels
from gateway.studio.notice import Notice
from gateway.studio.session import Session
from gateway.studio.worker import BUG, FleetReader
from sim.effects.effect import LawError

# Reaches into every widget: each lives in a shadow root, where the page's own rules end.
STYLE = """
:host { --font: 15px/1.45 system-ui, -apple-system, "Segoe UI", Roboto, sans-serif; font: var(--font); color: var(--ink); }
.bk-input, select.bk-input, .bk-input-group input { background: var(--field) !important; color: var(--ink) !important; border: 1px solid var(--edge) !important; border-radius: 6px !important; font: inherit; }
.bk-input-group > label, label, .bk-slider-title { color: var(--ink); font-size: 14px; }
.bk-input-group > label { white-space: normal; overflow-wrap: anywhere; }
.bk-spin-btn { --color: var(--ink); --disabled-color: var(--faint); }
.bk-slider-value { color: var(--ink); font-weight: 600; }
.bk-btn { font: inherit; border-radius: 6px !important; border: 1px solid var(--edge) !important; background: var(--field) !important; color: var(--ink) !important; white-space: normal; text-align: left; }
.bk-btn:hover { background: var(--soft) !important; }
.bk-btn.bk-btn-primary { background: var(--accent) !important; color: var(--on-accent) !important; border-color: var(--accent) !important; font-weight: 600; text-align: center; }
.bk-btn:disabled, .bk-btn[disabled] { opacity: 1 !important; color: var(--faint) !important; background: var(--ground) !important; border-style: dashed !important; }
.bk-btn:focus-visible, .bk-input:focus-visible, input:focus-visible, .noUi-handle:focus-visible { outline: 3px solid var(--accent) !important; outline-offset: 2px; }
.bk-btn-group { flex-wrap: wrap; }
.noUi-target { background: var(--line); border-color: var(--edge); } .noUi-connect { background: var(--accent) !important; } .noUi-handle { background: var(--paper); border-color: var(--accent); }
h1 { font-size: 1.35rem; margin: .2rem 0 .4rem; } h2 { font-size: 1.1rem; margin: .3rem 0; } h3 { font-size: 1rem; margin: .2rem 0; }
p { margin: .3rem 0; } summary { cursor: pointer; font-weight: 600; } .faint { color: var(--faint); font-size: .9rem; } .good { color: var(--good); font-weight: 600; } .warn { color: var(--warn); font-weight: 600; }
.word { text-decoration: underline dotted; text-underline-offset: 3px; cursor: help; border-radius: 3px; } .word:focus { outline: 3px solid var(--accent); outline-offset: 2px; } [role=tooltip] { display: none; }
.bk-slider-title, .bk-slider-value { white-space: normal; overflow-wrap: anywhere; }
.wide { overflow-x: auto; } table { border-collapse: collapse; width: 100%; font-variant-numeric: tabular-nums; }
th, td { text-align: right; padding: .3rem .6rem; border-bottom: 1px solid var(--line); vertical-align: top; } th { color: var(--faint); font-weight: 600; font-size: .88rem; }
th:first-child, td:first-child, td.text, th.text { text-align: left; } td.text { white-space: normal; }
pre { white-space: pre-wrap; font-size: 13px; margin: 0; } ul { margin: .2rem 0 .2rem 1.1rem; padding: 0; }
a { color: var(--accent); }
.fields { max-height: 20rem; overflow-y: auto; } button.field { font: inherit; color: var(--ink); background: var(--field); border: 1px solid var(--edge); border-radius: 6px; padding: .1rem .5rem; margin: 2px; cursor: grab; } button.field[aria-pressed=true] { background: var(--accent); color: var(--on-accent); } button.field:focus-visible { outline: 3px solid var(--accent); outline-offset: 2px; }
"""  # noqa: E501
NO_BUTTON = ".scroll-button { display: none; }"  # every column has one, and it takes room in a row
CARD = {
    "overflow-x": "auto",
    "background": "var(--paper)", "border": "1px solid var(--line)", "border-radius": "10px",
    "padding": "10px 14px", "margin": "0 0 14px 0",
}  # fmt: skip
BAR = {  # messages, at the lower edge of what is seen
    "background": "var(--paper)", "border-top": "1px solid var(--edge)", "padding": "6px 20px",
    "box-shadow": "0 -2px 8px rgba(0, 0, 0, .15)", "align-items": "center",
}  # fmt: skip
FIXED = {"stylesheets": [STYLE], "sizing_mode": "fixed", "margin": (5, 0)}  # widgets in a row


def set_style() -> None:
    """The style of all pages; once per process."""
    pn.config.raw_css.append(STYLE)
    pn.config.sizing_mode = "stretch_width"
    pn.config.notifications = False


def html(text: str = "", **more: Any) -> Any:
    """A piece of the page as HTML; the caller escapes texts from files and from the bus."""
    return pn.pane.HTML(text, sizing_mode="stretch_width", margin=0, stylesheets=[STYLE], **more)


def stack(*parts: Any, **more: Any) -> Any:
    """Parts one below the other."""
    return pn.Column(*parts, sizing_mode="stretch_width", **more)


def card(*parts: Any, **more: Any) -> Any:
    """Parts that belong together, on paper."""
    return stack(*parts, styles=CARD, **more)


def section(heading: str, hint: str, *parts: Any) -> Any:
    """A card under a heading with a hint, both HTML."""
    return card(html(f"<h2>{heading}</h2><p class='faint'>{hint}</p>"), *parts)


def side_by_side(*parts: Any) -> Any:
    """Parts side by side where there is room, else one below the other.

    Not a FlexBox: pictures in it are laid out before it has a width. Not a Row: it is never
    narrower than all its parts together.
    """
    for part in parts:
        part.styles = {**part.styles, "flex": "1 1 380px", "min-width": "min(100%, 320px)"}
    wrap = {"flex-direction": "row", "flex-wrap": "wrap", "gap": "0 14px"}
    return stack(*parts, styles=wrap, stylesheets=[NO_BUTTON], margin=0)


def control_row(*parts: Any) -> Any:
    """Small things in a row, on one line with their fields."""
    return pn.FlexBox(*parts, flex_wrap="wrap", align_items="flex-end",
                      gap="4px 10px", margin=0)  # fmt: skip


def button(text: str, pressed: Callable[[], None], kind: str = "default", **more: Any) -> Any:
    """A button that calls."""
    made = pn.widgets.Button(label=text, color=kind, **(FIXED | more))
    made.on_click(lambda _: pressed())
    return made


def select(label: str, options: Any, **more: Any) -> Any:
    """A choice of one."""
    return pn.widgets.Select(label=label, options=options, **FIXED, **more)


def field(label: str, **more: Any) -> Any:
    """A line of text to be filled in."""
    return pn.widgets.TextInput(label=label, **FIXED, **more)


def boxes(**more: Any) -> Any:
    """Boxes to be ticked."""
    return pn.widgets.CheckBoxGroup(stylesheets=[STYLE], margin=(5, 0), **more)


def download(label: str, filename: str, callback: Callable[[], Any], **more: Any) -> Any:
    """A button that hands a file to the browser."""
    return pn.widgets.FileDownload(label=label, filename=filename, callback=callback,
                                   color="default", **FIXED, **more)  # fmt: skip


def word(term: str, shown: str = "") -> str:
    """A term of the glossary: what it means shows under the pointer and at the keyboard's focus.

    The page's own script draws the tooltip, where nothing cuts it off; screen readers read the
    description.
    """
    key = f"tip-{re.sub('[^a-z0-9]+', '-', term.lower())}"
    return (f'<span class="word" tabindex="0" data-term="{escape(term)}" aria-describedby="{key}">'
            f'{escape(shown or term)}<span id="{key}" role="tooltip" hidden>'
            f"{escape(GLOSSARY[term])}</span></span>")  # fmt: skip


def table(heads: Sequence[str], rows: Sequence[Sequence[str]], text: Sequence[int] = ()) -> str:
    """A table of HTML cells; columns in `text` are set as text."""
    mark = [' class="text"' if i in text else "" for i in range(len(heads))]
    head = "".join(f"<th{m}>{h}</th>" for m, h in zip(mark, heads, strict=True))
    body = "".join(
        "<tr>" + "".join(f"<td{m}>{c}</td>" for m, c in zip(mark, row, strict=True)) + "</tr>"
        for row in rows
    )
    return f'<div class="wide"><table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table></div>'  # noqa: E501


def bullets(sentences: Sequence[str]) -> str:
    """Sentences as a list."""
    return "<ul>" + "".join(f"<li>{escape(sentence)}</li>" for sentence in sentences) + "</ul>"


def bokeh_part(layout: Any) -> Any:
    """A Bokeh figure or layout as a part of the page."""
    return pn.pane.Bokeh(layout, sizing_mode="stretch_width", margin=0)


def fill_source(source: Any, rows: Iterable[tuple[Any, ...]]) -> None:
    """Rows into a Bokeh data source; data that are shown already are not sent again."""
    every = list(rows)
    data = {name: [row[i] for row in every] for i, name in enumerate(source.column_names)}
    if source.data != data:
        source.data = data


def in_order() -> AbstractContextManager[None]:
    """Changes of a page go to the browser in the order in which they are made.

    Panel and Bokeh send on ways of their own: while the socket is busy, data of a figure that is
    new on the page would be there before the figure, which the browser does not take. Each change
    is kept: of two of one list only the last would hide parts that others in between refer to.
    """
    return pn.io.hold(policy="collect")


PERIOD_MS = 200
SHOW_QUICK_S = 0.5  # a comparison that takes longer is shown as work under way
TEMPLATE = (Path(__file__).parent / "template.html").read_text(encoding="utf-8")

Watches = Mapping[tuple[str, ...], Callable[[], None]]


@dataclass(frozen=True)
class PageEntry:
    """A page in the catalogue: its address, its title, where it stands, its class, what it is for.

    Pages stand in the order of `order`; the studio opens with the first.
    """

    path: str
    title: str
    order: int
    page: "type[Page]"
    description: str


@dataclass(frozen=True)
class StudioContext:
    """Given to every page: session, live boats, settings, the table of pages, a fleet."""

    session: Session
    live: LiveHistory
    settings: StudioSettings
    pages: Sequence[PageEntry]
    fleet: FleetReader = dataclass_field(default_factory=FleetReader)


class Page(ABC):
    """Base of all pages; a page declares its parts and what follows which change."""

    period_ms: ClassVar[int] = PERIOD_MS

    def __init__(self, context: StudioContext) -> None:
        self.context, self.session, self.address = context, context.session, Address()
        cookie = str((pn.state.cookies or {}).get("shadow_theme", ""))
        self.theme = THEMES.get(cookie, LIGHT)
        self.view = LinkedView(self.theme)
        self._seen: dict[tuple[str, ...], int] = {}
        self._seen_file: Path | None = None
        self._messages = html()
        self._cancel = button("Cancel", self.session.cancel, visible=False, width=90)
        self._close = button("Close", self._close_notices, visible=False, width=90)
        self._notice: Notice | None = None

    @abstractmethod
    def body(self) -> Any:
        """The parts of the page."""

    def watch(self) -> Watches:
        """Kinds of change -> what to do then; each is also called once at the start."""
        return {}

    def tick(self) -> None:  # noqa: B027
        """Called a few times a second; for what moves by itself."""

    def show(self, entry: PageEntry) -> Any:
        """The page as the server wants it."""
        self._bar = pn.Row(self._messages, self._cancel, self._close, styles=BAR,
                           sizing_mode="stretch_width", visible=False)  # fmt: skip
        template = pn.Template(TEMPLATE, location=True)  # else no address follows what is shown
        template.add_variable("theme", self.theme.name)
        template.add_variable("here", entry)
        template.add_variable("pages", self.context.pages)
        template.add_variable("run", self.session.run)
        template.add_panel("messages", self._bar)
        template.add_panel("main", stack(self.body()))
        self.caught(self._take_vessel)
        self._look()
        pn.state.onload(self._keep_looking)
        return template

    def _keep_looking(self) -> None:
        """From when the browser says that the page is there.

        It was handed out some time before, seconds where the server is busy, and what changes
        between the two Panel drops: figures would never be seen.
        """
        pn.state.add_periodic_callback(self._look, self.period_ms)

    def notify(self, text: str, good: bool = False) -> None:
        """A line on this page alone, until the next thing that is done here; good news fade."""
        self._notice = Notice(text, good, time.monotonic())

    def guarded(self, work: Callable[[], None]) -> Callable[[], None]:
        """Run an action of the user: it ends the message before; its errors are a line."""

        def run() -> None:
            self._notice = None
            self.caught(work)

        return run

    def caught(self, work: Callable[[], None]) -> None:
        """Work whose errors are a line on the page, never a traceback."""
        with in_order():
            try:
                work()
            except (ShadowError, LawError, RuntimeError) as error:
                self.notify(" ".join(str(error).split()))
            except Exception as error:  # the outermost loop of a page
                print(traceback.format_exc(), file=stderr, flush=True)
                self.notify(f"{BUG} ({type(error).__name__})")

    def _take_vessel(self) -> None:
        """The vessel file that the address names, unless changes of another would be lost."""
        asked, now = self.address.read("file"), self.session.vessel_file
        if asked is None or (now is not None and asked in (now.name, self._label(now))):
            return
        files = labels(self.session.folders.vessels())
        file = files.get(asked) or next((f for f in files.values() if f.name == asked), None)
        if file is None:
            self.notify(f"this address was made with {asked}, which is not in a folder given")
        elif not self.session.is_saved:
            self.notify(f"this address was made with {asked}; changes of {now.name if now else ''} "
                        "are not saved: choose it under Recordings")  # fmt: skip
        else:
            self.session.set_vessel(file)

    def _label(self, file: Path) -> str:
        """A vessel file's name as the pages show it, with its folder where others have the name."""
        named = labels(self.session.folders.vessels())
        return next((label for label, one in named.items() if one == file), file.name)

    def _name_vessel(self) -> None:
        """The address names the vessel file that is worked on."""
        file = self.session.vessel_file
        if self._seen_file != file:
            self._seen_file = file
            self.address.write(file=self._label(file) if file else None)

    def _close_notices(self) -> None:
        self._notice = self.session.notice = None

    def _look(self) -> None:
        with in_order():
            self._update()

    def _update(self) -> None:
        self.caught(self.session.update)
        for kinds, work in self.watch().items():
            now = sum(self.session.revision[kind] for kind in kinds)
            if self._seen.get(kinds) != now:
                self._seen[kinds] = now
                self.caught(work)
        self.caught(self.tick)
        self._name_vessel()
        self._show_messages()

    def _show_messages(self) -> None:
        """Show the job under way and the last messages, here and for all, with stop and close."""
        slow, quick = self.session.slow, self.session.quick
        lines = []
        if slow.busy:
            lines.append(f"<strong>{escape(str(slow.job))}</strong>: {escape(slow.progress)} "
                         f"<span class='faint'>({slow.seconds:.0f} s)</span>")  # fmt: skip
        if quick.busy and quick.seconds > SHOW_QUICK_S:
            lines.append(f"<strong>compare</strong>: {escape(quick.progress)}")
        notices = [one for one in (self.session.notice, self._notice) if one and one.holds]
        for one in notices:
            tone, role = ("good", "status") if one.good else ("warn", "alert")
            lines.append(f"<span class='{tone}' role='{role}'>{escape(one.text)}</span>")
        text = "".join(f"<p>{line}</p>" for line in lines)
        if self._messages.object != text:
            self._messages.object = text
        shown = ((self._cancel, slow.busy), (self._close, bool(notices)), (self._bar, bool(lines)))
        for made, wanted in shown:
            if made.visible != wanted:
                made.visible = wanted
