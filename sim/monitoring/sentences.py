"""What became of a live model, in words: since when it is wrong, where, and what it looks like."""

import numpy as np

from sim.monitoring import WindModel, air_velocity
from sim.monitoring.alarm import WATCHED_HORIZONS_S, Alarm, ModelEvent
from sim.monitoring.consistency import MIN_TIMES_FLOOR, Misfit
from sim.monitoring.disturbances import MIN_SCORE_BETWEEN_NATS, Cause, DisturbanceEstimate
from sim.monitoring.explanations import ALL_THRUSTERS
from sim.state import Floats

# Chosen on the tuning voyages of benchmarks/live_naming.py.
MAX_SINGLE_GAIN = 0.5  # of its thrust that one motor alone may push more than its file says
NO_THRUST_SHARE = 0.1  # of its thrust: what is left or astern of so little is none
MIN_SCORE_NEAREST_NATS = 2.0  # by which what comes nearest has to beat the boat alone, to be told
MAX_ERRING_MPS = 0.25  # of a receiver or a swell that errs for seconds
ERRING_VELOCITIES = "; a receiver or a swell whose velocities err for seconds looks so too"
ERROR_CHANNELS = (
    ("ahead", "m/s", 1.0),
    ("sideways", "m/s", 1.0),
    ("in turning", "°/s", 180.0 / np.pi),
)


def event_text(event: ModelEvent, alarm: Alarm, air: WindModel, since: str) -> str:
    """An event in one sentence; `since` is when it began, as people say it."""
    if event is ModelEvent.RIGHT:
        return f"the model is right again; it was wrong since {since}"
    where = f" when {worst}" if (worst := alarm.errors.worst) else ""
    if where.startswith((" when at", " when with", " when slower", " when faster")):
        where = where.removeprefix(" when")
    size, cause = _error_text(alarm.misfit), _cause_text(alarm, air)
    return f"since {since} the model is wrong{where} ({size}): {cause}"


def _cause_text(alarm: Alarm, air: WindModel) -> str:
    """What explains it, as far as that can be told."""
    estimate = alarm.told_by
    known = " and ".join(_kind_text(one.cause, one.estimate, air) for one in alarm.beside)
    if known:
        return f"{_cause_alone_text(alarm, estimate, air)}, beside {known}"
    return _cause_alone_text(alarm, estimate, air)


def _cause_alone_text(alarm: Alarm, estimate: DisturbanceEstimate, air: WindModel) -> str:
    """The same without what holds beside it."""
    current, wind = (_kind_text(kind, estimate, air) for kind in (Cause.CURRENT, Cause.WIND))
    match alarm.cause:
        case Cause.EITHER:
            tell = "what she does under way tells" if estimate.is_adrift else "other headings tell"
            return f"looks like current or wind ({current}, or {wind}): {tell}"
        case Cause.SEVERAL:
            several = " or ".join(_kind_text(kind, estimate, air) for kind in alarm.likely)
            return f"looks like {several}: turns, other headings and speeds tell"
        case Cause.NOTHING if alarm.too_early:
            return "too little seen so far to tell what it looks like"
        case Cause.NOTHING:
            nearest = _nearest_text(estimate, air)
            may_be_erring = ERRING_VELOCITIES if _may_be_erring(alarm.misfit) else ""
            return f"no one cause stands out{nearest}{may_be_erring}"
        case Cause.OTHER:
            return "none of current, wind, thrusters, compass and drag explains it"
    return f"looks like {_kind_text(alarm.cause, estimate, air)}"


def _nearest_text(estimate: DisturbanceEstimate, air: WindModel) -> str:
    """What explains it best where nothing is clearly more than nothing, if anything is."""
    named = [(score, kind) for score, kind, _ in estimate.named if kind is not Cause.OTHER]
    score, kind = named[0]
    clear = score - float(estimate.boat.score) >= MIN_SCORE_NEAREST_NATS
    if not clear or not estimate.best(kind).significant:
        return ""
    return f", nearest comes {_kind_text(kind, estimate, air)}"


def _kind_text(kind: Cause, estimate: DisturbanceEstimate, air: WindModel) -> str:
    """One explanation with its size."""
    best = estimate.best(kind)
    size = float(best.disturbance[0])
    match kind:
        case Cause.CURRENT:
            return current_text(best.disturbance)
        case Cause.WIND:
            return wind_text(best.disturbance, air)
        case Cause.THRUST:
            return _thrust_text(estimate)
        case Cause.COMPASS:
            side = "starboard" if size > 0.0 else "port"
            return f"the compass reading {abs(np.degrees(size)):.0f}° too far to {side}"
        case Cause.DRAG:
            return f"{_percent(size)} drag ahead"
    return "something else"


def _percent(share: float) -> str:
    """−0.45 -> "45 % less"."""
    return f"{abs(100.0 * share):.0f} % {'less' if share < 0.0 else 'more'}"


def _given(share: float) -> str:
    """Share of its thrust that a thruster gives more or less, in words; none gives less than
    nothing, but it may push astern.
    """
    if share < -1.0 - NO_THRUST_SHARE:
        return "pushing the other way"
    if share < -1.0 + NO_THRUST_SHARE:
        return "giving no thrust"
    return f"giving {_percent(share)} thrust"


def _thrust_text(estimate: DisturbanceEstimate) -> str:
    """The thruster that explains it best, and those that do so about as well; or all of them, where
    they do, or where one alone would have to push much more than its file says.
    """
    names = estimate.all.names
    ranked = [(score, f) for score, kind, f in estimate.named if kind is Cause.THRUST]
    near = [f for score, f in ranked if ranked[0][0] - score < MIN_SCORE_BETWEEN_NATS]
    share = {f: float(estimate.filter(f).disturbance[0]) for _, f in ranked}
    single = [f for f in near if names[f] != ALL_THRUSTERS]
    whole = next((f for _, f in ranked if names[f] == ALL_THRUSTERS), None)
    if single and whole is not None and share[single[0]] > MAX_SINGLE_GAIN:
        behind = float(estimate.scores[single[0]] - estimate.scores[whole])
        if behind < MIN_SCORE_BETWEEN_NATS and estimate.filter(whole).significant:
            near, single = [whole], []
    texts = []
    if single:
        which = " or ".join(names[f] for f in single)
        texts.append(f"thruster {which} {_given(share[single[0]])}")
    if whole in near:
        texts.append(f"all thrusters {_given(share[whole])}")
    return " or ".join(texts if near[0] != whole else reversed(texts))


def current_text(current: Floats) -> str:
    """North, east (2,) [m/s] -> speed and where it flows to."""
    return f"{np.hypot(*current):.2g} m/s of current towards {_bearing(current)}"


def wind_text(g: Floats, air: WindModel) -> str:
    """g of the air (2,) -> a wind and where it comes from, or its force on a boat across it."""
    if air.has_areas:
        return f"{np.hypot(*air_velocity(g)):.0f} m/s of wind from {_bearing(-g)}"
    force = float(f"{air.force_abeam(g):.2g}")
    return f"wind from {_bearing(-g)} that pushes with {force:g} N abeam"


def _bearing(north_east: Floats) -> str:
    degrees = round(float(np.degrees(np.arctan2(north_east[1], north_east[0])))) % 360
    return f"{degrees:03d}°"


def _may_be_erring(misfit: Misfit) -> bool:
    """Whether velocities are off most, and by no more than a receiver or a swell may make."""
    k = misfit.worst_channel
    return k < len(ERROR_CHANNELS) - 1 and bool(misfit.errors[0][k] < MAX_ERRING_MPS)


def _error_text(misfit: Misfit) -> str:
    """The worst channel's error beside its floor."""
    (error, floor), k = misfit.errors, misfit.worst_channel
    if error[k] ** 2 <= MIN_TIMES_FLOOR * floor[k] ** 2:  # it was more when it was called wrong
        return "of late hardly further off than noise explains"
    name, unit, factor = ERROR_CHANNELS[k]
    return (
        f"after {WATCHED_HORIZONS_S[0]} s off by {error[k] * factor:.2g} {unit} {name}, "
        f"noise explains {floor[k] * factor:.2g}"
    )
