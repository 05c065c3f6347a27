"""What `shadow report` says: the sentence on top of it, and where it is."""

from rich.console import Console

from gateway.pipelines.report import Reported


def show_reported(done: Reported) -> None:
    """Two lines."""
    out = Console(highlight=False)
    out.print(done.headline, markup=False)
    out.print(f"report: {done.path} ({done.size_bytes / 1e6:.1f} MB)", soft_wrap=True, markup=False)
