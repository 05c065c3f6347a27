"""The pages of the studio, by name: one file in this folder and one line here for each.

A plug-in registers its `PageEntry` objects under the entry point group `shadow.studio_pages`.
"""

from importlib.metadata import entry_points

from gateway.errors import BadInput
from gateway.studio.page import PageEntry
from gateway.studio.pages import compare, diagnose, fleet, live, recordings, signals, vessel

PAGES = (
    PageEntry("compare", "Compare", 10, compare.ComparePage, "how far the model is off, and where"),
    PageEntry("diagnose", "Diagnose", 20, diagnose.DiagnosePage, "which effect the model lacks"),
    PageEntry("vessel", "Vessel", 30, vessel.VesselPage, "the model's numbers, moved by sliders"),
    PageEntry("live", "Live", 40, live.LivePage, "boats and shadows as they move"),
    PageEntry("signals", "Signals", 45, signals.SignalsPage, "any field of a recording, plotted"),
    PageEntry("fleet", "Fleet", 48, fleet.FleetPage, "many recordings of many boats"),
    PageEntry("recordings", "Recordings", 50, recordings.RecordingsPage, "what to work on"),
)


def known_pages() -> tuple[PageEntry, ...]:
    """The pages above and those of installed plug-ins, in order."""
    plugged = (point.load() for point in entry_points(group="shadow.studio_pages"))
    pages = (*PAGES, *(page for page in plugged if isinstance(page, PageEntry)))
    paths = [page.path for page in pages]
    for path in paths:
        if paths.count(path) > 1:
            raise BadInput(f"studio page {path}: there are two of this name")
    return tuple(sorted(pages, key=lambda page: page.order))
