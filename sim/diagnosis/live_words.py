"""What a live diagnosis found, in a sentence: m/s, degrees, N."""

import numpy as np

from sim.diagnosis.air import Air, velocity
from sim.diagnosis.alarm import HORIZONS_S, Alarm, News
from sim.diagnosis.misfit import Misfit
from sim.diagnosis.online import Because
from sim.state import Floats

CHANNELS = (("ahead", "m/s", 1.0), ("sideways", "m/s", 1.0), ("in turning", "°/s", 180.0 / np.pi))


def sentence(news: News, alarm: Alarm, air: Air, since: str) -> str:
    """What there is to tell; `since` is when it began, as people say it."""
    if news is News.RIGHT:
        return f"the model is right again; it was wrong since {since}"
    where = f" when {worst}" if (worst := alarm.haunts.worst) else ""
    if where.startswith((" when at", " when with", " when slower", " when faster")):
        where = where.removeprefix(" when")
    return f"since {since} the model is wrong{where} ({_size(alarm.misfit)}): {cause(alarm, air)}"


def cause(alarm: Alarm, air: Air) -> str:
    """What explains it, as far as that can be told."""
    water, wind = alarm.outlook.water.outside, alarm.outlook.air.outside
    match alarm.because:
        case Because.CURRENT:
            return f"looks like {current(water)}"
        case Because.WIND:
            return f"looks like {blown(wind, air)}"
        case Because.EITHER:
            return f"looks like current or wind ({current(water)}, or {blown(wind, air)}): " + HINT
    if alarm.too_early:
        return "too little seen so far to tell current or wind from an error of the boat's own"
    return "neither a current nor a wind explains it"


HINT = "other headings tell"


def current(outside: Floats) -> str:
    """North, east (2,) [m/s] -> speed and where it flows to."""
    return f"{np.hypot(*outside):.2g} m/s of current towards {_degrees(outside)}"


def blown(g: Floats, air: Air) -> str:
    """g of the air (2,) -> a wind and where it comes from, or a force."""
    if air.has_areas:
        return f"{np.hypot(*velocity(g)):.0f} m/s of wind from {_degrees(-g)}"
    return f"a force of {np.hypot(*g):.2g} N towards {_degrees(g)}, as of wind"


def _degrees(north_east: Floats) -> str:
    degrees = round(float(np.degrees(np.arctan2(north_east[1], north_east[0])))) % 360
    return f"{degrees:03d}°"


def _size(misfit: Misfit) -> str:
    """The worst channel's error beside its floor."""
    error, floor = misfit.errors
    k = int(np.argmax(error / np.maximum(floor, 1e-12)))
    name, unit, factor = CHANNELS[k]
    return (
        f"after {HORIZONS_S[0]} s off by {error[k] * factor:.2g} {unit} {name}, "
        f"noise explains {floor[k] * factor:.2g}"
    )
