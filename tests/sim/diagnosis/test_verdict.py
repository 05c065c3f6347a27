"""From what was found to an answer: the rules, one by one, on made-up findings."""

from collections.abc import Sequence
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from sim.diagnosis import free_curve
from sim.diagnosis.answer import LadderStep, StepBase, Verdict, falling
from sim.diagnosis.free_curve import FreeCurve, find_free_curve
from sim.diagnosis.heldout import Gain, HeldOutScore
from sim.diagnosis.verdict import (
    does_without_effects,
    is_above_noise,
    is_above_stated,
    is_curve_above_form,
    is_more_than_form,
    rivals_of,
    seen_one_step_ahead,
    summary_of,
    unexplained_share,
    verdict_of,
)
from sim.effects.catalogue import named
from sim.effects.effect import Effect
from sim.effects.tables import Formula
from sim.vessel import AddedEffect
from tests.sim.diagnosis.rankings import starts
from tests.sim.voyages import WAM_V

FAR = (2.0, 2.0, 1.0)  # of what is stated as noise, in u, v, r: more than drift leaves


def selection(won: float = 100.0, name: str = "hull_lift", steps: int = 1) -> Any:
    gain = SimpleNamespace(nats=won)
    step = SimpleNamespace(best=SimpleNamespace(gain=gain))
    added = (SimpleNamespace(effect=named(name)),)
    return SimpleNamespace(steps=(step,) * steps, fit=SimpleNamespace(added=added))


def gained(nats: float, lost: float = 0.0, t: float = 5.0) -> Gain:
    return Gain(1.2, 0.1, t, nats, lost)


def step(nrmse: float, *effects: str) -> LadderStep:
    return LadderStep(effects, StepBase.REFITTED, HeldOutScore(nrmse, None), (), {}, WAM_V)


LEFT: Any = SimpleNamespace(description="it follows the heading")
RIVAL: Any = SimpleNamespace(name="cg_offset")


def test_what_is_left_makes_it_unknown_whatever_was_found() -> None:
    assert verdict_of(selection(), [[RIVAL]], [LEFT], False) is Verdict.UNKNOWN
    assert verdict_of(selection(steps=0), [], [LEFT], False) is Verdict.UNKNOWN
    assert verdict_of(selection(steps=0), [], [], True) is Verdict.UNKNOWN
    assert verdict_of(selection(steps=0), [], [], False) is Verdict.ADEQUATE
    assert verdict_of(selection(), [[RIVAL]], [], False) is Verdict.CONFOUNDED
    assert verdict_of(selection(), [[]], [], False) is Verdict.EXPLAINED


def test_an_error_far_above_the_noise_is_not_explained() -> None:
    found, names = [named("hull_lift")], ("hull_lift",)
    assert is_above_noise((), [step(0.5), step(0.5)], 0.2, FAR)
    assert not is_above_noise((), [step(0.5), step(0.13)], 0.1, FAR)
    assert is_above_noise(found, [step(0.9), step(0.9), step(0.6, *names)], 0.1, FAR)
    assert not is_above_noise(
        found, [step(0.9), step(0.9), step(0.4, *names)], 0.1, FAR
    )  # its form
    assert not is_above_noise(found, [step(9.0), step(9.0), step(0.4, *names)], 0.1, FAR)
    assert is_above_noise(
        found, [step(9.0), step(9.0), step(0.6, *names)], 0.1, FAR
    )  # of the motion
    half_way = [step(0.6), step(0.54), step(0.348, *names)]
    assert is_above_noise(found, half_way, 0.079, FAR)  # a third and more is left: a river's mouth
    assert not is_above_noise(found, half_way, 0.26, FAR)  # no more than a complete model may leave


@pytest.mark.parametrize(
    ("last", "share", "told"),
    [
        (0.102, (1.0, 0.99, 1.32), False),  # an exact model under an EKF's and a GPS's drift
        (0.15, (1.26, 1.24, 1.15), False),  # 0.07 m/s that last 5 s: 1.9 floors
        (0.102, (2.0, 0.99, 1.32), True),
        (0.102, (1.0, 0.99, 2.1), True),
        (0.168, (1.53, 1.58, 1.08), False),  # 0.1 m/s that last 8 s: 2.4 floors
        (0.21, (1.0, 0.99, 1.32), True),  # three floors
    ],
)
def test_free_runs_that_drift_are_no_sign_where_moments_are_as_stated(last, share, told) -> None:
    ladder = [step(0.25), step(last)]
    assert is_above_noise((), ladder, 0.079 if last == 0.15 else 0.069, share) is told
    found = [named("hull_lift")]
    assert is_above_noise(found, [*ladder, step(0.35, "hull_lift")], 0.069, share)


@pytest.mark.parametrize(
    ("error", "low", "told"), [(0.25, 0.103, False), (0.25, 0.13, True), (0.33, 0.103, True)]
)
def test_one_turn_the_other_way_makes_no_stranger(error: float, low: float, told: bool) -> None:
    """78 % of the squared error of an exact model lay in 7 % of the time."""
    left = replace(step(error), heldout=HeldOutScore(error, (low, 0.385)))
    assert is_above_noise((), [step(0.27), left], 0.079, (0.94, 0.97, 1.19)) is told


def test_the_drift_of_free_runs_is_said_of_a_model_that_is_whole() -> None:
    ladder = [step(0.102), step(0.102)]
    drifts = summary_of(Verdict.ADEQUATE, ladder, [], [], 0.069, drifts=True)
    assert drifts.startswith("no effect of the catalogue is missing as far as these data can tell")
    assert "it follows nothing that was looked for" in drifts
    assert "errors of the measured velocities that last, gusts, and weak causes" in drifts
    seen: Any = SimpleNamespace(name="hull_lift", gain=Gain(1.25, 0.2, 4.6, 144.0, 0.09))
    beside = summary_of(Verdict.ADEQUATE, ladder, [], [], 0.069, small=seen, drifts=True)
    assert "follows nothing" not in beside  # but what is seen
    assert "only from one moment to the next is hull_lift seen" in beside
    whole = summary_of(Verdict.ADEQUATE, ladder, [], [], 0.069)
    assert "that last" not in whole


def test_a_train_that_leaves_the_most_of_a_sea_does_not_explain_it() -> None:
    def above(last: float, *also: str) -> bool:
        names = ("wave_motion", *also)
        ladder = [step(0.383), step(0.383), step(last, *names)]
        return is_above_noise([named(name) for name in names], ladder, 0.123, FAR)

    assert above(0.375)
    assert above(0.375, "hull_lift")
    assert not above(0.25)  # a part of nature: the rest of the sea is left
    assert not above(0.17)


def test_little_is_left_by_a_form_that_nature_chose_differently() -> None:
    def matters(g: Gain, above_noise: bool, **found: Any) -> bool:
        return is_more_than_form(g, selection(**found), above_noise)

    assert matters(gained(30.0), False, won=100.0)
    assert not matters(gained(20.0), False, won=100.0)
    assert not matters(gained(30.0), False, won=1000.0)
    assert matters(gained(30.0), True, won=1000.0)
    assert not matters(gained(90.0), True, won=100.0, name="wave_motion")
    assert matters(gained(300.0, lost=0.1, t=1.0), True, won=100.0)  # in few blocks
    assert not matters(gained(300.0, lost=0.5, t=1.0), True, won=100.0)


def test_what_gusts_leave_of_a_wind_is_no_sign_of_anything_else() -> None:
    """Only what depends on the time, only beside a wind, and only about as much as gusts are."""

    def matters(nats: float, name: str, *, of_time: bool) -> bool:
        wind = selection(won=1000.0, name=name)
        return is_more_than_form(gained(nats), wind, above_noise=True, of_time=of_time)

    assert not matters(150.0, "steady_wind", of_time=True)
    assert matters(150.0, "steady_wind", of_time=False)
    assert matters(150.0, "steady_current", of_time=True)
    assert matters(170.0, "steady_wind", of_time=True)
    ladder = [step(1.0), step(1.0), step(0.35, "steady_wind")]
    assert not is_above_noise([named("steady_wind")], ladder, 0.06, FAR)
    assert is_above_noise([named("steady_current")], ladder, 0.06, FAR)
    ladder = [step(1.0), step(1.0), step(0.45, "steady_wind")]
    assert is_above_noise([named("steady_wind")], ladder, 0.06, FAR)


@pytest.mark.parametrize(("last", "share"), [(0.5, 1.0), (0.1, 0.0), (0.05, 0.0), (0.13**0.5, 0.5)])
def test_the_share_unexplained_runs_from_all_to_none(last: float, share: float) -> None:
    assert unexplained_share([step(0.5), step(last)], 0.1) == pytest.approx(share)


def test_a_vessel_at_the_floor_leaves_nothing_unexplained() -> None:
    assert unexplained_share([step(0.08), step(0.08)], 0.1) == 0.0


@pytest.mark.parametrize(("floor", "noisy"), [(0.1, True), (0.25, False)])
def test_what_is_left_above_the_noise_is_said_of_what_explains(floor: float, noisy: bool) -> None:
    """Of one train of waves in a sea "explained" was all that was said, a weak motor beside it."""
    ladder = [step(0.5), step(0.4), step(0.3, "wave_motion")]
    for verdict, rivals in ((Verdict.EXPLAINED, []), (Verdict.CONFOUNDED, [RIVAL])):
        said = summary_of(verdict, ladder, [rivals], [], floor)
        assert ("3.0 times the noise is left, and weaker causes may hide in it" in said) is noisy


def test_the_sentence_names_what_was_found_and_what_it_may_be_taken_for() -> None:
    ladder = [step(0.5), step(0.4), step(0.1, "hull_lift")]
    explained = summary_of(Verdict.EXPLAINED, ladder, [[]], [], 0.09)
    assert explained.startswith("hull_lift: the error on unseen time falls from 0.500 to 0.100")
    assert "cannot tell it from cg_offset" in summary_of(
        Verdict.CONFOUNDED, ladder, [[RIVAL]], [], 0.09
    )
    assert summary_of(Verdict.UNKNOWN, ladder, [[]], [LEFT], 0.09).endswith("follows the heading")
    assert summary_of(Verdict.UNKNOWN, ladder, [[]], [], 0.05).endswith("that was looked for")
    swings = summary_of(Verdict.UNKNOWN, ladder, [[]], [], 0.05, None, 1.62)
    assert "swings with a period of some 1.6 s, as in a sea" in swings
    assert "as in a sea" not in summary_of(Verdict.UNKNOWN, ladder, [[]], [LEFT], 0.05, None, 1.62)
    odd = summary_of(Verdict.UNKNOWN, ladder, [[]], [LEFT], 0.05, None, None, ("a lag",))
    assert odd.endswith("contradict one another (a lag): that comes before any effect")
    assert "no effect" in summary_of(Verdict.ADEQUATE, ladder[:2], [], [], 0.09)


def test_an_error_of_ten_times_the_motion_hides_none_that_is_left() -> None:
    """A free run of an unstable hull erred by 9.6; of that 0.544 was but the share of gusts."""
    wind = [named("wind_change")]
    left = step(0.544, "wind_change")
    assert is_above_noise(wind, [step(17.9), step(9.6), left], 0.183, FAR)
    assert is_above_noise(wind, [step(17.9), step(1.0), left], 0.183, FAR)
    assert not is_above_noise(wind, [step(17.9), step(9.6), step(0.4, "wind_change")], 0.183, FAR)


def test_what_only_one_step_ahead_shows_is_told_and_nothing_else() -> None:
    """A complete model's best of the ranking leaves at most 2 % less."""
    row = SimpleNamespace(name="hull_lift", gain=Gain(1.25, 0.2, 4.6, 144.0, 0.09))
    found = SimpleNamespace(steps=(), first=SimpleNamespace(finalists=(row,)))
    assert seen_one_step_ahead(found) is row
    said = summary_of(Verdict.ADEQUATE, [step(0.2), step(0.1)], [], [], 0.19, small=row)
    assert said.endswith("seen, with 20 % less of the squared error")
    assert "as far as these data can tell" not in said
    row.gain = Gain(1.02, 0.016, 1.8, 25.0, 0.12)
    assert seen_one_step_ahead(found) is None
    row.gain = Gain(1.25, 0.2, 1.0, 19.0, 0.9)  # a few blocks, and what others lose
    assert seen_one_step_ahead(found) is None
    found.first.finalists = ()
    assert seen_one_step_ahead(found) is None
    added = SimpleNamespace(steps=(0,), first=SimpleNamespace(finalists=(row,)))
    row.gain = Gain(1.25, 0.2, 4.6, 144.0, 0.09)
    assert seen_one_step_ahead(added) is None


def test_a_base_that_fitted_predicts_no_better_is_not_told_as_better() -> None:
    kept = replace(step(0.2), base=StepBase.KEPT)
    said = summary_of(Verdict.ADEQUATE, [step(0.2), kept], [], [], 0.19)
    assert "0.200 as given, no better with the base re-fitted" in said
    said = summary_of(Verdict.ADEQUATE, [step(0.2), step(0.1)], [], [], 0.19)
    assert "0.200 as given, 0.100 with the base re-fitted" in said


def test_a_rival_does_nearly_as_well_and_no_block_tells_it_apart() -> None:
    def row(name: str, log_ratio: float, t_of_best: float = 0.0, general_of: str = "") -> Any:
        gain = Gain(2.0, log_ratio, 5.0, 100.0, 0.0)
        over = SimpleNamespace(t=t_of_best)
        return SimpleNamespace(
            name=name, gain=gain, over=over,
            effect=SimpleNamespace(
                general_of=general_of, parameters=(), disbelieved=None, undone=None
            ),
            found=AddedEffect(named("cubic_drag"), starts("cubic_drag")),
            fit=SimpleNamespace(problem=SimpleNamespace(vessel=WAM_V)),
        )  # fmt: skip

    def among(best: Any, *others: Any) -> list[str]:
        best.gain_over = lambda other: other.over
        ranking: Any = SimpleNamespace(finalists=(best, *others), best=best)
        return [r.name for r in rivals_of(ranking, ("found",))]

    best = row("best", 0.5)
    assert among(best, row("near", 0.4), row("far", 0.3)) == ["near"]
    assert among(best, row("told apart", 0.4, 3.5), row("not", 0.4, 2.5)) == ["not"]
    assert among(best, row("found", 0.4), row("general", 0.4, general_of="best")) == []
    assert among(best, *(row(name, 0.45) for name in "abcd")) == ["a", "b"]
    best.gain = gained(1.0, t=0.5)._replace(log_ratio=0.5)  # no more than chance
    assert among(best, row("near", 0.4)) == []
    nobody: Any = SimpleNamespace(finalists=())
    assert rivals_of(nobody) == []


def test_no_step_of_the_ladder_raises_the_error() -> None:
    a, b, c = step(0.6, "hull_lift"), step(0.3, "hull_lift", "cg_offset"), "cubic_drag"
    last = step(0.2, "hull_lift", "cg_offset", c)
    assert errors(falling([step(0.5), step(0.4), a, b, last])) == [0.5, 0.4, 0.3, 0.2]
    assert errors(falling([step(0.5), step(0.4), step(0.1, "hull_lift"), last])) == [0.5, 0.4, 0.2]
    assert falling([step(0.5), step(0.4), a, b, last])[2].new == 2
    assert errors(falling([step(0.5), step(0.4)])) == [0.5, 0.4]


def errors(ladder: Sequence[LadderStep]) -> list[float]:
    return [s.heldout.nrmse for s in ladder]


def test_more_than_the_stated_noise_in_surge_or_sway_is_no_noise() -> None:
    found = [named("hull_lift")]
    assert is_above_stated([], (2.1, 0.6, 0.6))
    assert not is_above_stated([], (1.58, 1.53, 1.08))  # velocity errors that last
    assert is_above_stated(found, (0.6, 2.6, 0.6))
    assert not is_above_stated([], (0.8, 0.8, 9.0))  # gusts
    assert not is_above_stated(found, (1.6, 0.6, 0.6))  # nature's own form
    assert not is_above_stated([named("wave_motion")], (9.0, 9.0, 0.6))


def test_a_curve_in_the_place_of_an_effect_is_told_before_it() -> None:
    ladder = [step(0.5), step(0.4), step(0.3, "hull_lift")]

    def said(
        *effects: str, formula: Any = None, as_well: tuple[Effect, ...] = (), over: Any = None,
        contradictions: tuple[str, ...] = (), against: tuple[str, ...] = ("hull_lift",),
    ) -> str:  # fmt: skip
        below: Any = SimpleNamespace(
            step=step(0.2, *effects), replaces=len(effects) == 1, description="a force",
            formula=formula, as_well=as_well, over=over, against=against,
        )  # fmt: skip
        return summary_of(
            Verdict.UNKNOWN, ladder, [[]], [], 0.1, below, contradictions=contradictions
        )

    beside, instead = said("hull_lift", "x"), said("x")
    assert beside.startswith("hull_lift helps, ")
    assert "nearest" not in beside
    assert "with that curve the error on unseen time falls from 0.300 to 0.200" in beside
    assert instead.startswith("something is missing that the catalogue does not hold: a force; ")
    assert (
        "falls from 0.500 to 0.200 (noise 0.100); nearest to it comes hull_lift, the error on"
        in instead
    )
    assert "as well does" not in instead
    assert "moment" not in instead
    closer = said("x", over=gained(100.0))  # Gain.ratio 1.2
    assert "(noise 0.100); from one moment to the next it leaves 17 % less of the" in closer
    assert "squared error than hull_lift; nearest" in closer
    first = said("x", over=gained(100.0), against=("battery_sag",))
    assert "than battery_sag, the first of the ranking; nearest" in first
    assert "than the boat without it; nearest" in said("x", over=gained(100.0), against=())
    assert "moment" not in said("x", over=gained(100.0)._replace(ratio=1.0))
    lag = said("x", contradictions=("yaw comes late",))
    assert (
        "(yaw comes late): that comes before any effect; as an error of a sensor: a force; " in lag
    )
    line: Any = SimpleNamespace(formula=SimpleNamespace(text="X = c u, c = 3"), nrmse=0.203)
    assert "as well does X = c u, c = 3 (0.203); nearest" in said("x", formula=line)
    also = said("x", as_well=(named("learned_history"), named("learned_map")))
    assert "as well does a curve that changes as time goes by" in also
    assert "or differs from place to place" in also
    ladder.append(step(0.25, "hull_lift", "cg_offset"))
    assert said("hull_lift", "cg_offset", "x").startswith("hull_lift and cg_offset help, ")
    assert "nearest to it come hull_lift and cg_offset, the error" in said("x")


def test_a_curve_alone_comes_before_one_beside_effects_that_is_hardly_better(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    errors = {"base": 0.203, "effects": 0.2}
    chosen: Any = SimpleNamespace(fit="effects", fits=("effects",), base="base")
    scorer: Any = SimpleNamespace(score_fit=lambda fit: SimpleNamespace(nrmse=0.3))

    def curve(vessel: Any, fit: Any, *_: Any) -> FreeCurve:
        effects = ("x",) if fit == "base" else ("hull_lift", "x")
        none: Any = None
        return FreeCurve(step(errors[fit], *effects), none, fit)

    formula: Any = SimpleNamespace()
    monkeypatch.setattr(free_curve, "_fitted", curve)
    monkeypatch.setattr(free_curve, "_short_formula", lambda *_: formula)

    def found(**how: bool) -> tuple[str, ...]:
        best = find_free_curve(WAM_V, chosen, scorer, **how)
        assert best is not None
        return best.step.effects

    assert found() == ("x",)
    errors["effects"] = 0.19
    assert found() == ("hull_lift", "x")
    assert found(beside=False) == ("x",)
    for without, law in ((0.3, formula), (0.195, None)):  # what nothing explains as well has no law
        scorer.score_fit = lambda fit, without=without: SimpleNamespace(nrmse=without)
        best = find_free_curve(WAM_V, chosen, scorer)
        assert best is not None
        assert best.formula is law


def test_a_curve_is_told_by_the_last_effect_of_its_vessel() -> None:
    learned, none = named("learned"), SimpleNamespace()
    made: Any = none
    offset = AddedEffect(named("heading_offset"), {"angle": 0.1})
    vessel = WAM_V.with_effects(offset, AddedEffect(learned, dict(learned.example)))
    curve = FreeCurve(replace(step(0.2, "heading_offset", "learned"), vessel=vessel), made, made)
    assert curve.description.startswith("a force ahead with the speed ahead: ")


def test_a_formula_goes_through_the_curve_as_surely_as_each_knot_is_known() -> None:
    """A knot's standard deviation is a quarter of its interval; the shortest law that predicts as
    well is told, each held-out fit with its own.
    """
    told: list[dict[str, float]] = []
    scored: list[list[float]] = []

    def formulas(_: Any, values: Any, std: Any) -> list[Formula]:
        told.append(dict(std))
        made = {key: 10.0 * x for key, x in values.items()}
        return [Formula(name, name, {}, made) for name in ("short", "long", "longer")]

    def score_fit(_: Any, changed: Any) -> HeldOutScore:
        scored.append(list(changed(np.array([7.0, 1.0, 2.0]))))
        return HeldOutScore({1: 0.3, 2: 0.205}.get(len(scored), 0.1), None)

    effect = SimpleNamespace(name="learned", formulas=formulas)
    added = SimpleNamespace(effect=effect, values={"f0": 1.0, "f1": 2.0})
    vessel: Any = SimpleNamespace(effects=(added,))
    known: Any = SimpleNamespace(name="learned.f0", ci95=(0.6, 1.4))
    last = replace(step(0.2, "learned"), vessel=vessel, parameters={"learned": (known,)})
    model = SimpleNamespace(names=["m11", "learned.f0", "learned.f1"])
    made: Any = SimpleNamespace(unknowns=SimpleNamespace(model=model))
    scorer: Any = SimpleNamespace(score_fit=score_fit)
    found = free_curve._short_formula(FreeCurve(last, made, made), scorer)
    assert told[0] == pytest.approx({"f0": 0.2, "f1": 0.0})
    assert found is not None
    assert (found.formula.form, found.nrmse) == ("long", 0.205)
    assert scored == [[7.0, 10.0, 20.0]] * 2


def test_only_a_clearly_better_curve_takes_the_place_of_effects() -> None:
    ladder, none = [step(0.5), step(0.4), step(0.3, "hull_lift")], SimpleNamespace()
    made: Any = none
    won = SimpleNamespace(best=SimpleNamespace(gain=gained(1000.0)))
    calm, sea = (SimpleNamespace(is_coloured=coloured) for coloured in (False, True))
    added = [SimpleNamespace(effect=named("hull_lift"))]
    lift, beside_waves = (
        SimpleNamespace(fits=(made,), steps=(won,), fit=SimpleNamespace(added=added, problem=p))
        for p in (calm, sea)
    )
    nothing: Any = SimpleNamespace(fits=(), steps=(), fit=SimpleNamespace(added=[], problem=calm))

    def does(
        after: float, *effects: str, over: Gain | None = None, found: Any = lift, floor: float = 0.1
    ) -> bool:
        curve = FreeCurve(step(after, *effects), made, made, over)
        return does_without_effects(curve, found, ladder, floor, above_noise=False)

    assert does(0.28, "x")
    assert not does(0.295, "x")  # the right effect in nature's own form
    assert not does(0.2, "hull_lift", "x")
    assert not does(0.28, "x", floor=0.3)  # both are noise to free runs
    assert does(0.28, "x", floor=0.3, over=gained(70.0))
    assert does(0.295, "x", over=gained(70.0))  # told from one moment to the next
    assert not does(0.295, "x", over=gained(50.0))  # of a thousand: the form
    assert not does(0.295, "x", over=gained(70.0, t=1.0)._replace(lost=0.6))
    assert not does(0.2, "hull_lift", "x", over=gained(70.0))
    small = gained(70.0)._replace(log_ratio=0.05)  # a drag that grows a little otherwise
    assert not does(0.295, "x", over=small)
    assert not does(0.28, "x", found=nothing)  # gusts have a history, too
    assert does(0.295, "x", over=gained(30.0), found=nothing)
    assert not does(0.28, "x", found=beside_waves)  # a curve of commands that answered the waves
    assert does(0.28, "x", over=gained(70.0), found=beside_waves)


def test_a_curve_beside_an_effect_counts_where_it_takes_away_a_noticeable_error() -> None:
    ladder = [step(0.645), step(0.613), step(0.125, "steady_wind")]

    def counts(after: float, effect: str = "steady_wind") -> bool:
        below: Any = SimpleNamespace(step=step(after))
        return is_curve_above_form(below, [named(effect)], ladder, 0.099)

    assert not counts(0.099)  # the form of the wind
    ladder = [step(0.645), step(0.613), step(0.3, "hull_lift")]
    assert counts(0.1, "hull_lift")
    assert not counts(0.29, "hull_lift")


def test_an_error_that_does_not_fall_is_not_said_to_fall() -> None:
    def said(last: float) -> str:
        ladder = [step(2.694), step(2.694), step(last, "hull_lift")]
        return summary_of(Verdict.EXPLAINED, ladder, [[]], [], 0.1)

    assert "rises from 2.694 to 4.336" in said(4.336)
    assert "stays at 2.694" in said(2.6942)
    assert "falls from 2.694 to 0.300" in said(0.3)


def test_data_whose_noise_hides_the_motion_do_not_say_that_nothing_is_missing() -> None:
    ladder = [step(1.21), step(1.21)]
    assert "cannot tell whether" in summary_of(Verdict.ADEQUATE, ladder, [], [], 12.4)
    assert "cannot tell whether" not in summary_of(Verdict.ADEQUATE, ladder, [], [], 1.0 / 3.0)


def test_an_error_that_falls_only_on_recordings_that_were_fitted_is_told_so() -> None:
    def said(left_out: float | None) -> str:
        scores = [HeldOutScore(0.8, None), HeldOutScore(0.8, None), None]
        if left_out is not None:
            scores[2] = HeldOutScore(left_out, None)
        steps = (step(0.8), step(0.7), step(0.3, "heading_offset"))
        ladder = [replace(s, left_out=score) for s, score in zip(steps, scores, strict=True)]
        return summary_of(Verdict.EXPLAINED, ladder, [], [], 0.25)

    assert said(0.9).endswith("which the fit did not see: 0.800 as given, 0.900 so")
    assert "did not see" not in said(0.4)
    assert "did not see" not in said(None)


def test_what_is_left_of_an_explained_error_is_in_the_verdict() -> None:
    assert Verdict.EXPLAINED.in_words(0.27) == (
        "found most of what is missing, but not the last 27 %"
    )
    assert Verdict.EXPLAINED.in_words(0.85) == (
        "found a part of what is missing: 85 % of it is left"
    )
    assert Verdict.EXPLAINED.in_words(0.04) == "found what is missing"
    assert Verdict.ADEQUATE.in_words(1.0) == "nothing is missing that these data could tell"


@pytest.mark.parametrize(
    ("over", "after", "taken"),
    [
        (gained(70.0), 0.3, True),
        (gained(70.0), 0.31, False),  # free runs become worse
        (gained(70.0)._replace(log_ratio=0.05), 0.3, False),
        (gained(10.0, lost=0.5, t=1.0), 0.3, False),
        (gained(10.0, lost=0.5, t=1.0), 0.25, True),  # free runs tell
    ],
)
def test_a_curve_is_taken_where_free_runs_or_single_moments_tell(
    monkeypatch: pytest.MonkeyPatch, over: Gain, after: float, taken: bool
) -> None:
    rival: Any = SimpleNamespace(renewed_problem=None, names=("hull_lift",))
    base: Any = SimpleNamespace(added=(), noise_share=(9.0, 9.0, 9.0), model=lambda: None)
    curve = SimpleNamespace(nrmse=after)
    errors = {id(base): 0.4, id(curve): after}
    last: Any = SimpleNamespace()
    errors[id(last)] = 0.3
    scorer: Any = SimpleNamespace(
        score_fit=lambda fit: SimpleNamespace(nrmse=errors[id(fit)]), noise_floor=0.1, given=0.35
    )
    scorer.shared_with = lambda _: scorer
    row = SimpleNamespace(name="learned", effect=named("learned"), fit=curve, gain=gained(500.0))
    monkeypatch.setattr(
        free_curve, "rank", lambda *_, **how: SimpleNamespace(reference=base, finalists=(row,))
    )
    monkeypatch.setattr(free_curve, "_refined", lambda *given: given[-1])
    monkeypatch.setattr(free_curve, "gain_under", lambda *_: over)
    monkeypatch.setattr(free_curve.SupersetModel, "of", lambda *_: None)
    monkeypatch.setattr(free_curve.LadderStep, "of", lambda *_: step(after, "learned"))
    forms = [named("learned")]
    found = free_curve._fitted(WAM_V, base, scorer, last, print, map, forms, rival)
    assert (found is not None) == taken
    assert found is None or (found.over, found.against) == (over, ("hull_lift",))


def test_a_curve_is_held_against_the_best_of_the_catalogue_though_it_helps_no_free_run() -> None:
    """Motors that lose thrust astern, on a voyage that hardly goes astern, are no new effect."""
    base, first, fit = (SimpleNamespace(names=(name,)) for name in ("base", "first", "fit"))

    def rival(gain: Gain | None, *fits: Any) -> Any:
        row = SimpleNamespace(effect=named("reverse_loss"), gain=gain, fit=first)
        ranking = SimpleNamespace(finalists=(row,) if gain else ())
        made: Any = SimpleNamespace(base=base, fits=fits, first=ranking, fit=[base, *fits][-1])
        return free_curve._best_of_catalogue(made)

    assert rival(gained(30.0)) is first
    assert rival(gained(-1.0)) is base
    assert rival(None) is base
    assert rival(gained(30.0), fit) is fit
