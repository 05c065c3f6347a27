"""Areas above water of a boat whose file has none, from its length and beam.

    A_F = 0.10 L B,   A_L = 0.12 L²        L, B [m]; A_F, A_L frontal and lateral area [m²]

What is above the water of a small unmanned boat: hulls, a deck, a mast with aerials. The factors
are the middle of the boats whose areas are known or were judged from pictures: A_F / (L B) from
0.07 (WAM-V, 4.9 m) to 0.15 (an open boat of 1.8 m), A_L / L² from 0.07 (WAM-V) to 0.17 (light
catamarans of 1.2 m); of the shipped ones BlueBoat has 0.09 and 0.14, the demo boat 0.10 and 0.14.
All lie within `AREA_FACTOR` of what is assumed. Valid for: boats of 0.8 to 6 m without a cabin.

What a boat's motion tells of the wind is a force, ½ ρ V² C A: areas k times as large stand for a
wind 1/√k times as fast.
"""

FRONT_SHARE, SIDE_SHARE = 0.10, 0.12  # A_F / (L B), A_L / L²
AREA_FACTOR = 2.0  # the areas are taken to be right to within this factor
DIGITS = 3  # of the areas: no more is known, and a file then holds exactly what is assumed


def assumed_wind_areas(length: float, beam: float) -> tuple[float, float]:
    """Length, beam [m] -> frontal, lateral area [m²]."""
    areas = (FRONT_SHARE * length * beam, SIDE_SHARE * length**2)
    front, side = (float(f"{area:.{DIGITS}g}") for area in areas)
    return front, side


def areas_text(front: float, side: float) -> str:
    """That areas [m²] were assumed, in words."""
    return (
        "areas above water assumed from length and beam: "
        f"frontal {front:.3g} m², lateral {side:.3g} m²"
    )
