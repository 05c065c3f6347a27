"""The one palette, safe for colour-blind eyes (Okabe and Ito, Color Universal Design, 2008)."""

from gateway.pictures.figure_data import Role

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
