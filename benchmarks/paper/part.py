"""What one experiment gives: a table, a verdict, pictures."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from gateway.figures import FigureData


@dataclass(frozen=True)
class Part:
    """`lines` are Markdown; `held` tells of each demand whether it is met."""

    title: str
    lines: tuple[str, ...]
    held: Mapping[str, bool] = field(default_factory=dict)
    pictures: Mapping[str, FigureData] = field(default_factory=dict)

    def text(self) -> str:
        """The part as Markdown."""
        return "\n".join([f"## {self.title}", "", *self.lines, ""])
