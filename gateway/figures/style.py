"""The one palette, safe for colour-blind eyes (Okabe and Ito, Color Universal Design, 2008).

How pictures look on screen, light and dark; every pair of text and ground is WCAG AA.
"""

from dataclasses import dataclass

import numpy as np

from gateway.figures.figure_data import Role

COLOUR = {
    Role.MEASURED: "#0072B2",  # blue
    Role.MODEL: "#D55E00",  # vermilion
    Role.SHADOW: "#009E73",  # bluish green
    Role.ERROR: "#CC79A7",  # reddish purple
    Role.FLOOR: "#000000",  # black: lies on bars of any colour
    Role.INTERVAL: "#000000",
    Role.CONTEXT: "#767676",  # grey, 4.5 : 1 on white
}

# From little to much, falling steadily in lightness: readable in grey print too.
LITTLE_TO_MUCH = ("#DCE9F2", "#56B4E9", "#0072B2", "#5B2A86", "#1B0A2A")


CHOSEN = "#E69F00"  # orange of the same palette: what the user pointed at


@dataclass(frozen=True)
class Look:
    """Colours of one theme. Measured, model and shadow are the same in both."""

    name: str
    paper: str
    ink: str
    faint: str  # text of less weight
    grid: str
    ramp: tuple[str, ...]  # from little to much: what is much stands out from the paper
    strong: str  # floors and intervals: as far from the paper as can be

    def colour(self, role: Role) -> str:
        """The colour of a role on this paper."""
        return self.strong if role in (Role.FLOOR, Role.INTERVAL) else COLOUR[role]

    def scale(self, steps: int = 64) -> list[str]:
        """The ramp as so many colours."""
        stops = np.array([[int(c[i : i + 2], 16) for i in (1, 3, 5)] for c in self.ramp])
        at = np.linspace(0.0, len(stops) - 1.0, steps)
        mixed = [np.interp(at, np.arange(len(stops)), stops[:, k]) for k in range(3)]
        return [f"#{r:02x}{g:02x}{b:02x}" for r, g, b in np.rint(mixed).astype(int).T]


LIGHT = Look("light", "#FFFFFF", "#1B2430", "#55606E", "#E3E7EC", LITTLE_TO_MUCH, "#000000")
DARK = Look(
    "dark", "#171C23", "#E8ECF1", "#A9B4C2", "#2C3540",
    ("#24384A", "#0072B2", "#56B4E9", "#CBE8F8", "#FFFFFF"), "#FFFFFF",
)  # fmt: skip
LOOKS = {look.name: look for look in (LIGHT, DARK)}
