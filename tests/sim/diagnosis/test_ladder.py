"""Which effect comes next on the ladder: the rules, on made-up rankings."""

from collections.abc import Collection, Container
from dataclasses import replace
from itertools import combinations
from types import MappingProxyType, SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from sim.diagnosis import rivals as rivals_module
from sim.diagnosis.heldout import Gain, RankedEffect, Ranking, gain, select_finalists
from sim.diagnosis.ladder import EffectSearch
from sim.diagnosis.rivals import all_rivals_of, beside_unshown
from sim.diagnosis.thresholds import MIN_NATS_IN_FEW_BLOCKS, MIN_SHARE_OF_EARLIER
from sim.diagnosis.verdict import rivals_of
from sim.diagnosis.worth import helps
from sim.effects.catalogue import EFFECTS, named
from sim.effects.effect import Effect
from tests.sim.diagnosis.made_scorer import MadeScorer
from tests.sim.diagnosis.rankings import BLOCK, FIRST, SOME, row, starts
from tests.sim.vessels import VALUES
from tests.sim.voyages import WAM_V

HIDDEN = "steering_lag"  # worth most, and yet no prediction is better with it


class Made(EffectSearch):
    """Ranks what it is given, and again what a closer look finds; all but one effect help."""

    rows: tuple[RankedEffect, ...]
    closer: tuple[RankedEffect, ...] = ()

    def rank(
        self, fit: Any, closer: bool = False, among: Container[str] | None = None,
        present: Any = None,
    ) -> Ranking:  # fmt: skip
        return Ranking(FIRST, self.closer if closer else self.rows)

    def helps(self, before: Any, after: Any) -> bool:
        return bool(after.name != HIDDEN)

    def is_believed(self, row: Any, reference: Any) -> bool:
        return True


def made(*rows: RankedEffect) -> Made:
    nothing: Any = None
    scorer: Any = MadeScorer(0.1)
    search = Made(nothing, (), 4, lambda _: None, map, scorer)
    object.__setattr__(search, "rows", rows)
    return search


def looking_closer(floor: float, *closer: RankedEffect) -> Made:
    """A search whose first look finds nothing, with effects that declare further starts."""
    search = replace(made(LITTLE), effects=EFFECTS)
    object.__setattr__(search, "rows", (LITTLE,))
    object.__setattr__(search, "closer", closer)
    cast(Any, search.scorer).noise_floor = floor
    return search


def names(ranking: Ranking) -> list[str]:
    return [r.name for r in ranking.finalists]


MUCH = row(HIDDEN, Gain(2.0, 0.5, 5.7, 700.0, 0.0))
LITTLE = row("cg_offset", Gain(1.01, 0.005, 1.2, 15.0, 0.5))


def test_what_a_larger_error_hides_waits_for_its_turn() -> None:
    ranking, more = made(MUCH, SOME).ranked(FIRST, [])
    assert names(ranking) == ["heading_offset", HIDDEN]
    assert more


def test_where_none_is_worth_it_the_best_stays_first() -> None:
    search = made(MUCH, LITTLE)
    ranking, more = search.ranked(FIRST, [])
    assert names(ranking) == [HIDDEN, "cg_offset"]
    assert not more
    assert not search.justified(ranking.best, [], FIRST)


def test_far_above_the_noise_a_second_look_is_closer() -> None:
    ranking, more = looking_closer(0.1, SOME).ranked(FIRST, [])
    assert names(ranking) == ["heading_offset"]
    assert more


def test_near_the_noise_nothing_more_is_looked_for() -> None:
    ranking, more = looking_closer(0.4, SOME).ranked(FIRST, [])
    assert names(ranking) == ["cg_offset"]
    assert not more


@pytest.mark.parametrize(
    ("won", "enough"), [(100.0, True), (104.0 / MIN_SHARE_OF_EARLIER + 1.0, False)]
)
def test_a_later_effect_is_more_than_the_form_of_an_earlier_one(won: float, enough: bool) -> None:
    search = made(SOME)
    earlier = row("hull_lift", Gain(2.0, 0.5, 5.0, won, 0.0))
    steps = [search.rank(FIRST).led_by(earlier)]
    assert search.justified(SOME, steps, FIRST) is enough
    noticeable = row("heading_offset", SOME.gain, nrmse=0.45)  # of an error of 1 as given
    assert search.justified(noticeable, steps, FIRST)


def test_few_blocks_may_tell_if_hardly_any_contradicts() -> None:
    search = made()
    for nats, lost, enough in (
        (MIN_NATS_IN_FEW_BLOCKS + 1, 0.1, True),
        (MIN_NATS_IN_FEW_BLOCKS - 1, 0.1, False),
        (90, 0.3, False),
    ):
        braking = row("astern_stall", Gain(1.1, 0.01, 1.0, nats, lost))
        assert search.justified(braking, [], FIRST) is enough


def test_an_effect_of_ones_own_is_fitted_whatever_it_promises() -> None:
    def screened(name: str, deviance: float) -> Any:
        effect = SimpleNamespace(general_of="")
        return SimpleNamespace(name=name, deviance=deviance, added=SimpleNamespace(effect=effect))

    many = [screened(effect.name, 10.0 + i) for i, effect in enumerate(EFFECTS[:12])]
    keel = screened("keel", 99.0)
    plain, asked = select_finalists(many), select_finalists([*many, keel])
    assert 0 < len(plain) <= 6
    assert keel in asked
    assert keel not in select_finalists([keel, *many])[1:]


def test_three_are_fitted_and_of_the_others_those_with_a_tenth_of_the_best_ones_promise() -> None:
    def chosen(*deviances: float) -> int:
        none = SimpleNamespace(effect=SimpleNamespace(general_of=""))
        pairs = zip(EFFECTS, deviances, strict=False)
        results: Any = [SimpleNamespace(name=e.name, deviance=d, added=none) for e, d in pairs]
        return len(select_finalists(results))

    assert chosen(0.0, 100.0, 100.0, 100.0, 100.0) == 3
    assert chosen(0.0, 10.0, 20.0, 89.0, 91.0, 100.0) == 4
    assert chosen(0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 100.0) == 6


def test_a_special_case_is_fitted_wherever_its_general_form_is() -> None:
    def screened(name: str, deviance: float) -> Any:
        return SimpleNamespace(
            name=name, deviance=deviance, added=SimpleNamespace(effect=named(name))
        )

    others = (
        "hull_lift",
        "towed_load",
        "cg_offset",
        "cross_damping",
        "cubic_drag",
        "antenna_offset",
    )
    few = [screened("current_change", 1.0), *(screened(n, 5.0 + i) for i, n in enumerate(others))]
    last = screened("steady_current", 90.0)
    assert last in select_finalists([*few, last])
    assert last not in select_finalists([*few[1:], last])


def test_what_holds_another_effect_whole_never_stands_beside_it() -> None:
    change, steady, lift = (named(n) for n in ("current_change", "steady_current", "hull_lift"))
    nothing: Any = None
    search = EffectSearch(nothing, (change, steady, lift), 4, nothing, map, nothing)

    def beside(*effects: Effect) -> list[str]:
        added = [SimpleNamespace(effect=e) for e in effects]
        fit: Any = SimpleNamespace(added=added, names=tuple(e.name for e in effects))
        return [e.name for e in search._others(fit)]

    assert beside(change) == ["hull_lift"]
    assert beside(steady) == ["hull_lift"]
    assert beside(lift) == ["current_change", "steady_current"]


def test_what_was_found_beside_it_is_no_rival() -> None:
    ranking = made(SOME, MUCH).rank(FIRST)
    assert [r.name for r in rivals_of(ranking)] == [HIDDEN]
    assert rivals_of(ranking, ("heading_offset", HIDDEN)) == []


def test_an_effect_must_predict_better_than_what_was_given_too() -> None:
    assert helped(given=0.3)
    assert not helped(given=0.16)  # re-fitted it was worse than as given


def test_where_no_more_than_noise_is_left_an_effect_must_help_more() -> None:
    assert helped(given=0.3, after=0.197)
    assert not helped(given=0.3, after=0.197, share=(0.6, 0.7, 0.8))
    assert helped(given=0.3, after=0.17, share=(0.6, 0.7, 0.8))
    assert not helped(given=0.3, after=0.197, floor=0.25)
    assert helped(given=0.3, after=0.19, floor=0.25)


def helped(
    given: float, after: float = 0.17, share: Any = (2.0, 2.0, 2.0), floor: float = 0.1
) -> bool:
    base, effect = SimpleNamespace(nrmse=0.2, noise_share=share), SimpleNamespace(nrmse=after)
    return helps(*cast(Any, (MadeScorer(floor, given), [base], effect)))


def found(*names: str) -> Any:
    """A fit with these effects."""
    added = tuple(
        SimpleNamespace(effect=named(name), values=VALUES.get(name, {})) for name in names
    )
    return SimpleNamespace(
        names=names, added=added, effects=lambda: added, nrmse=1.0 - 0.1 * len(names),
        noise_share=(2.0, 2.0, 2.0), problem=SimpleNamespace(trials=(None,)),
    )  # fmt: skip


class Scripted(EffectSearch):
    """A current that became another one: first taken for a steady one beside a varying one.

    `best` has what leads beside what; the change may not stand beside the steady current that it
    holds as a part.
    """

    best = MappingProxyType({
        (): "steady_current", ("steady_current",): "varying_current",
        ("steady_current", "varying_current"): "heading_offset",
        ("varying_current", "heading_offset"): "steady_current",
        ("steady_current", "heading_offset"): "varying_current",
        ("varying_current",): "steady_current", ("heading_offset",): "current_change",
    })  # fmt: skip

    def rank(
        self, fit: Any, closer: bool = False, among: Container[str] | None = None,
        present: Any = None,
    ) -> Ranking:  # fmt: skip
        name = self.best.get(fit.names)
        if name is None or (among is not None and name not in among):
            return Ranking(fit, ())
        worth = Gain(2.0, 0.5, 5.7, 700.0, 0.0)
        others = (row("heading_offset", LITTLE.gain),) if name != "heading_offset" else ()
        return Ranking(
            fit, (RankedEffect(named(name), found(*fit.names, name), worth, 0.5), *others)
        )

    def is_believed(self, row: Any, reference: Any) -> bool:
        return True

    def _begun_with_forces(self, base: Any) -> list[Ranking]:
        return []

    def _in_place_by_forces(self, first: Any, steps: Any, fit: Any) -> Any:
        return steps, fit

    def _beside(self, added: Any, like: Any, problem: Any = None) -> Any:
        return found(*(a.effect.name for a in added))

    def _gain_over(self, fit: Any, other: Any) -> Gain:
        """Only the steady current is not missed, and only the change is worth a swap."""
        nothing = Gain(1.0, 0.0, 0.0, 0.0, 1.0)
        lost = set(fit.names) - set(other.names)
        return nothing if lost == {"steady_current"} else Gain(2.0, 0.5, 5.7, 700.0, 0.0)


@pytest.mark.parametrize("beside_varying", ["steady_current", "heading_offset"])
def test_what_was_kept_out_by_an_effect_that_went_gets_its_place(
    beside_varying: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whether the steady current goes last of all or gives way to the heading offset."""
    best = {**Scripted.best, ("varying_current",): beside_varying}
    monkeypatch.setattr(Scripted, "best", best)
    monkeypatch.setattr("sim.diagnosis.ladder.final_fit", lambda fit: fit)
    nothing: Any = None
    scorer: Any = MadeScorer(0.1)
    search = Scripted(nothing, EFFECTS, 4, lambda _: None, map, scorer)
    monkeypatch.setattr(Scripted, "helps", lambda self, before, after: True)
    selection = search.run(found(), *search.ranked(found(), []))
    assert selection.fit.names == ("heading_offset", "current_change")


def test_a_steady_case_that_took_its_changes_place_leads_the_ranking_that_is_told(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Not the change, with a probability that the answer does not share."""
    nothing, same = cast(Any, None), Gain(1.0, 0.0, 0.0, 0.0, 1.0)
    monkeypatch.setattr(Scripted, "best", {(): "current_change"})
    monkeypatch.setattr(Scripted, "helps", lambda self, before, after: True)
    monkeypatch.setattr(Scripted, "_gain_over", lambda self, fit, other: same)
    monkeypatch.setattr("sim.diagnosis.ladder.final_fit", lambda fit: fit)
    scorer: Any = MadeScorer(0.1)
    search = Scripted(nothing, EFFECTS, 1, lambda _: None, map, scorer)
    selection = search.run(found(), *search.ranked(found(), []))
    assert selection.fit.names == ("steady_current",)
    assert [row.name for row in selection.first.finalists] == ["steady_current", "heading_offset"]
    assert selection.steps[0].best is selection.first.best


@pytest.mark.parametrize("others", [(), (LITTLE,)])
def test_where_the_best_cannot_be_fitted_again_its_look_alikes_are_no_rivals(
    monkeypatch: pytest.MonkeyPatch, others: tuple[RankedEffect, ...]
) -> None:
    offset = row("heading_offset", MUCH.gain)
    base: Any = SimpleNamespace(model=lambda: None)
    step = Ranking(base, (offset, LITTLE))
    monkeypatch.setattr(rivals_module, "rank", lambda *_, **__: Ranking(base, others))
    search = replace(made(offset), unshown=(named("compass_deviation"),))
    assert [r.name for r in beside_unshown(step, search).finalists] == ["heading_offset"]


class Weather(EffectSearch):
    """Water and wind of a boat whose truth is known: what a set of effects leaves of the error."""

    left: dict[frozenset[str], float]
    left_out = MappingProxyType[frozenset[str], float]({})  # on recordings left out

    def fit_of(self, names: tuple[str, ...]) -> Any:
        nrmse = self.left[frozenset(names)]
        residual = np.full(len(BLOCK), 10.0 * nrmse)
        share = (2.0, 2.0, 2.0) if nrmse > 0.1 else (0.7, 0.7, 0.7)
        return SimpleNamespace(
            names=names, nrmse=nrmse, heldout_residual=residual, noise_share=share,
            problem=SimpleNamespace(block=BLOCK, vessel=WAM_V),
            added=[SimpleNamespace(effect=named(name)) for name in names],
            values=starts, left_out=self.left_out.get(frozenset(names)),
            effects=lambda: [
                SimpleNamespace(effect=named(name), values=VALUES.get(name, {})) for name in names
            ],
        )  # fmt: skip

    def rank(
        self, fit: Any, closer: bool = False, among: Container[str] | None = None,
        present: Any = None,
    ) -> Ranking:  # fmt: skip
        rows = []
        for name in sorted(n for n in cast(Any, among) if frozenset((*fit.names, n)) in self.left):
            beside = self.fit_of((*fit.names, name))
            won = gain(fit.heldout_residual, beside.heldout_residual, BLOCK)
            rows.append(RankedEffect(named(name), beside, won, 0.5))
        rows.sort(key=lambda r: -r.gain.ratio)
        return Ranking(fit, tuple(rows))

    def _beside(self, added: Any, like: Any, problem: Any = None) -> Any:
        return self.fit_of(tuple(a.effect.name for a in added))

    def _gain_over(self, fit: Any, other: Any) -> Gain:
        return gain(other.heldout_residual, fit.heldout_residual, BLOCK)

    def is_believed(self, row: Any, reference: Any) -> bool:
        return True


def made_scorer() -> Any:
    return MadeScorer(0.05)


def exchanged(found: tuple[str, ...], most: int = 4, **left: float) -> tuple[str, ...] | None:
    """What stands after an exchange, given what each set of effects leaves ("a__b")."""
    nothing: Any = None
    search = Weather(nothing, EFFECTS, most, lambda _: None, map, made_scorer())
    known = {frozenset(key.split("__")): value for key, value in left.items()}
    object.__setattr__(search, "left", {frozenset(): 1.0, **known})
    steps = [Ranking(FIRST, (row(name, SOME.gain),)) for name in found]
    out = search._exchanged(steps, search.fit_of(found))
    if out is None:
        return None
    rankings, fit = out
    assert tuple(r.best.name for r in rankings) == fit.names
    return cast(tuple[str, ...], fit.names)


def test_one_change_takes_the_place_of_two_that_stood_in_for_it() -> None:
    """Where it does as well: a wind that turned, for a change of current and a steady wind."""
    two = ("current_change", "steady_wind")
    left = {"current_change__steady_wind": 0.3, "current_change": 0.6, "steady_wind": 0.7}
    assert exchanged(two, **left, wind_change=0.1) == ("wind_change",)
    assert exchanged(two, **left, wind_change=0.5) is None


def test_two_take_the_place_of_one_change_that_stood_in_for_them() -> None:
    left = {"current_change": 0.4, "steady_current": 0.7}
    better = {**left, "steady_current__wind_change": 0.2}
    assert exchanged(("current_change",), **better) == ("steady_current", "wind_change")
    worse = {**left, "steady_current__wind_change": 0.41}
    assert exchanged(("current_change",), **worse) is None
    assert exchanged(("current_change",), most=1, **better) is None


def test_of_two_changes_one_is_steady_where_the_other_is_better_found_anew_beside_it() -> None:
    """A current that ran all day, and a wind that rose: its moment was taken for one of both."""
    two = ("current_change", "wind_change")
    left = {"current_change__wind_change": 0.4, "current_change": 0.6, "steady_current": 0.7}
    better = {**left, "steady_current__wind_change": 0.25}
    assert exchanged(two, **better) == ("steady_current", "wind_change")
    assert exchanged(two, **left, steady_current__wind_change=0.4) is None
    other = {**left, "wind_change": 0.9, "steady_wind": 0.8, "current_change__steady_wind": 0.2}
    assert exchanged(two, **other) == ("steady_wind", "current_change")
    told = {**better, "current_change__wind_change": 0.09}
    assert exchanged(two, **told) is None  # no more than noise is left


def test_a_change_that_leaves_noise_alone_is_not_exchanged() -> None:
    left = {"current_change": 0.09, "steady_current": 0.7, "steady_current__wind_change": 0.08}
    assert exchanged(("current_change",), **left) is None


def standing_out(
    *names: str, most: int = 4, more: bool = True, recordings: int = 1, **left: float
) -> tuple[str, ...]:
    """What a search finds where these stand out in the forces; the first ranking is led by a lift
    that should be added, or (`more`) should not.
    """
    nothing: Any = None
    laws = tuple(effect for effect in EFFECTS if not effect.is_curve)

    class Begun(Weather):
        asked = False

        def _begun_with_forces(self, base: Any) -> list[Ranking]:
            object.__setattr__(self, "asked", True)
            each = [self.rank(self.fit_of(names[:i]), among={n}) for i, n in enumerate(names)]
            return each if len(each) > 1 else []

        def _next(self, steps: Any, fit: Any) -> list[Ranking]:
            return []

        def _swapped(self, steps: Any, fit: Any, last: bool = False) -> Any:
            return steps, fit

        def _exchanged(self, steps: Any, fit: Any) -> None:
            return None

    search = Begun(nothing, laws, most, lambda _: None, map, made_scorer())
    known = {frozenset(key.split("__")): value for key, value in left.items()}
    object.__setattr__(search, "left", {frozenset(): 1.0, **known})
    base = search.fit_of(())
    base.problem.trials = (None,) * recordings
    _, fit = search._found(base, search.rank(base, among={"hull_lift"}), more)
    return (*fit.names, "asked") if search.asked else cast(tuple[str, ...], fit.names)


ONE_BY_ONE = {"hull_lift": 0.6, "steady_current": 0.7, "steady_current__heading_offset": 0.2}
TWO = ("steady_current", "heading_offset")


def test_a_search_begins_with_what_stands_out_in_the_forces_where_one_effect_leaves_much() -> None:
    assert standing_out(*TWO, **ONE_BY_ONE) == (*TWO, "asked")
    assert standing_out(*TWO, more=False, **ONE_BY_ONE) == (*TWO, "asked")
    assert standing_out("steady_current", **ONE_BY_ONE) == ("hull_lift", "asked")


def test_what_stands_out_must_predict_better_than_one_effect_does() -> None:
    worse = {**ONE_BY_ONE, "steady_current__heading_offset": 0.61}
    assert standing_out(*TWO, **worse) == ("hull_lift", "asked")
    nothing = {**ONE_BY_ONE, "steady_current__heading_offset": 1.01}
    assert standing_out(*TWO, more=False, **nothing) == ("asked",)


def test_near_the_noise_and_for_one_effect_no_forces_are_asked() -> None:
    assert standing_out(*TWO, **{**ONE_BY_ONE, "hull_lift": 0.07}) == ("hull_lift",)
    assert standing_out(*TWO, most=1, **ONE_BY_ONE) == ("hull_lift",)
    assert standing_out(*TWO, recordings=2, **ONE_BY_ONE) == (*TWO, "asked")
    assert standing_out(*TWO, recordings=3, **ONE_BY_ONE) == ("hull_lift",)


def made_simpler(**left: float) -> tuple[str, ...]:
    """What stands after a wind that turned, beside an inertial force, may be a steady one."""
    nothing: Any = None
    search = Weather(nothing, EFFECTS, 4, lambda _: None, map, made_scorer())
    known = {frozenset(key.split("__")): value for key, value in left.items()}
    object.__setattr__(search, "left", {frozenset(): 1.0, **known})
    object.__setattr__(search, "_special_of", lambda *_: None)
    names = ("inertial_force", "wind_change")
    rows = [row("inertial_force", SOME.gain), row("wind_change", SOME.gain)]
    ranked = Ranking(FIRST, (rows[0], row("current_change", SOME.gain)))
    steps = [ranked, Ranking(FIRST, (rows[1],))]
    rankings, fit = search._made_simpler(steps, search.fit_of(names))
    assert {r.best.name for r in rankings} == set(fit.names)
    return cast(tuple[str, ...], fit.names)


def test_beside_a_special_case_what_it_kept_from_its_place_is_chosen_again() -> None:
    """A wind that turned had taken the part of a current, and an inertial force the rest."""
    left = {
        "inertial_force": 0.7, "steady_wind": 0.6, "current_change": 0.8,
        "inertial_force__wind_change": 0.3, "inertial_force__steady_wind": 0.3,
        "current_change__steady_wind": 0.1,
    }  # fmt: skip
    assert set(made_simpler(**left)) == {"steady_wind", "current_change"}
    stays = {**left, "current_change__steady_wind": 0.31}
    assert set(made_simpler(**stays)) == {"steady_wind", "inertial_force"}
    apart = {**stays, "inertial_force__steady_wind": 0.9}
    assert set(made_simpler(**apart)) == {"wind_change", "inertial_force"}


@pytest.mark.parametrize(("steady", "stands"), [(0.21, "steady_current"), (0.4, "current_change")])
def test_a_change_gives_way_to_a_steady_one_that_does_as_well(steady: float, stands: str) -> None:
    nothing: Any = None
    scorer: Any = MadeScorer(0.05)
    search = Weather(nothing, EFFECTS, 4, lambda _: None, map, scorer)
    found, other = ("current_change", "hull_lift"), frozenset({"hull_lift", "steady_current"})
    left = {frozenset({"hull_lift"}): 0.8, frozenset(found): 0.2095, other: steady}
    object.__setattr__(search, "left", left)
    steps = [Ranking(FIRST, (row(name, SOME.gain),)) for name in found]
    steps, fit = search._simplified(steps, search.fit_of(found))
    assert {stands, "hull_lift"} == set(fit.names)


@pytest.mark.parametrize(("steady", "stands"), [(0.21, "steady_current"), (0.4, "current_change")])
def test_a_change_found_alone_gives_way_too_though_the_ranking_preferred_it(
    steady: float, stands: str
) -> None:
    """Few steps may not lead to the steady one from afar, but from where the change ended."""
    nothing: Any = None
    scorer: Any = MadeScorer(0.05)
    search = Weather(nothing, EFFECTS, 4, lambda _: None, map, scorer)
    left = {frozenset({"current_change"}): 0.2095, frozenset({"steady_current"}): steady}
    object.__setattr__(search, "left", left)
    others = (row("steady_current", LITTLE.gain), row("steady_wind", LITTLE.gain))
    steps = [Ranking(FIRST, (row("current_change", SOME.gain), *others))]
    (step,), fit = search._simplified(steps, search.fit_of(("current_change",)))
    assert fit.names == (stands,)
    assert [r.name for r in step.finalists].count("steady_current") == 1
    assert step.best.name == stands


@pytest.mark.parametrize(("left", "rivals"), [(0.1, ["steady_wind"]), (0.3, [])])
def test_a_rival_does_as_well_beside_all_others(left: float, rivals: list[str]) -> None:
    """What did as well while the others were missing is none where it does not beside them."""
    nothing: Any = None
    search = Weather(nothing, EFFECTS, 4, lambda _: None, map, made_scorer())
    found = ("heading_offset", "current_change")
    known = {("heading_offset",): 0.8, found: 0.1, ("heading_offset", "steady_wind"): left}
    object.__setattr__(search, "left", {frozenset(k): v for k, v in known.items()})
    alike = [row(name, SOME.gain) for name in ("current_change", "steady_wind")]
    step = Ranking(FIRST, tuple(alike))
    assert [r.name for r in rivals_of(step, found)] == ["steady_wind"]
    selection: Any = SimpleNamespace(steps=(step, step), fit=search.fit_of(found))
    assert [r.name for r in all_rivals_of(step, search, selection)] == rivals


@pytest.mark.parametrize(("errs", "rivals"), [(0.59, ["heading_offset"]), (0.61, [])])
def test_what_errs_more_over_ten_seconds_is_no_rival(errs: float, rivals: list[str]) -> None:
    """However close from one moment to the next."""
    best = row("thruster_imbalance", SOME.gain, nrmse=0.5)
    step = Ranking(FIRST, (best, row("heading_offset", SOME.gain, nrmse=errs)))
    assert [r.name for r in rivals_of(step)] == ["heading_offset"]
    nothing: Any = None
    search = EffectSearch(nothing, EFFECTS, 4, nothing, map, made_scorer())
    fit: Any = SimpleNamespace(names=("thruster_imbalance",))
    selection: Any = SimpleNamespace(steps=(step,), fit=fit)
    assert [r.name for r in all_rivals_of(step, search, selection)] == rivals


@pytest.mark.parametrize(("left", "rivals"), [(0.1, ["steady_wind"]), (0.3, [])])
def test_a_rival_does_as_well_without_what_went_again(left: float, rivals: list[str]) -> None:
    """A lift that was dropped in the end stood beside both when they were ranked."""
    nothing: Any = None
    search = Weather(nothing, EFFECTS, 4, lambda _: None, map, made_scorer())
    found = ("current_change",)
    known = {(): 0.8, found: 0.1, ("steady_wind",): left}
    object.__setattr__(search, "left", {frozenset(k): v for k, v in known.items()})
    lift: Any = SimpleNamespace(names=("hull_lift",), added=(), nrmse=0.5)
    alike = tuple(row(name, SOME.gain) for name in ("current_change", "steady_wind"))
    selection: Any = SimpleNamespace(steps=(Ranking(lift, alike),), fit=search.fit_of(found))
    (step,) = selection.steps
    assert [r.name for r in all_rivals_of(step, search, selection)] == rivals


def swapped(left: float, **left_out: float) -> tuple[str, ...]:
    """What stands after swaps of a hull lift with a steady wind beside it, which leave 0.3; `left`
    of cross damping in its place.
    """
    nothing: Any = None
    scorer: Any = MadeScorer(0.05)
    search = Weather(nothing, EFFECTS, 4, lambda _: None, map, scorer)
    names = ("hull_lift", "steady_wind")
    known = {
        "steady_wind": 0.6, "hull_lift": 0.7, "cross_damping": 0.8,
        "hull_lift__steady_wind": 0.3, "steady_wind__cross_damping": left,
    }  # fmt: skip
    for key, values in (("left", known), ("left_out", left_out)):
        by_names = {frozenset(name.split("__")): x for name, x in values.items()}
        object.__setattr__(search, key, by_names)
    first = (row("hull_lift", SOME.gain), row("cross_damping", SOME.gain))
    steps = [Ranking(FIRST, first), Ranking(FIRST, (row("steady_wind", SOME.gain),))]
    return cast(tuple[str, ...], search._swapped(steps, search.fit_of(names))[1].names)


def test_what_stood_in_for_another_gives_way_beside_what_came_later() -> None:
    assert set(swapped(left=0.2)) == {"steady_wind", "cross_damping"}
    assert swapped(left=0.31) == ("hull_lift", "steady_wind")


def test_nothing_takes_a_place_that_predicts_recordings_left_out_worse() -> None:
    elsewhere = {"hull_lift__steady_wind": 0.4, "steady_wind__cross_damping": 0.5}
    assert swapped(0.2, **elsewhere) == ("hull_lift", "steady_wind")
    better = {**elsewhere, "steady_wind__cross_damping": 0.3}
    assert set(swapped(0.2, **better)) == {"steady_wind", "cross_damping"}


@pytest.mark.parametrize(
    ("other", "without", "stays"),
    [("hull_lift", 0.5, True), ("hull_lift", 0.3, False), ("towed_load", 0.5, False)],
)
def test_no_effect_goes_without_which_recordings_left_out_are_predicted_worse(
    other: str, without: float, stays: bool
) -> None:
    """From one moment to the next it is not missed. Of a load of that day the recording that is
    left out has told how much there is, so that it is no witness.
    """
    nothing: Any = None
    scorer: Any = MadeScorer(0.05)
    search = Weather(nothing, EFFECTS, 4, lambda _: None, map, scorer)
    names = (other, "steady_wind")
    both, wind = frozenset(names), frozenset({"steady_wind"})
    object.__setattr__(search, "left", {both: 0.3, wind: 0.301, frozenset({other}): 0.9})
    object.__setattr__(search, "left_out", {both: 0.4, wind: without})
    steps = [Ranking(FIRST, (row(name, SOME.gain),)) for name in names]
    _, fit = search._backward(steps, search.fit_of(names))
    assert set(fit.names) == (both if stays else wind)


class Sides(Weather):
    """One of two motors is weak: what an imbalance leaves alone depends on where it begins."""

    anew: float

    def rank(self, fit: Any, *asked: Any, **more: Any) -> Ranking:
        with_other_side = {**self.left, frozenset({"thruster_imbalance"}): self.anew}
        before = self.left
        object.__setattr__(self, "left", with_other_side)
        ranking = super().rank(fit, *asked, **more)
        object.__setattr__(self, "left", before)
        return ranking


@pytest.mark.parametrize(("anew", "stays"), [(0.301, False), (0.5, True)])
def test_two_weak_motors_and_a_strong_one_give_way_to_one_weak_motor_on_the_other_side(
    anew: float, stays: bool
) -> None:
    nothing: Any = None
    search = Sides(nothing, EFFECTS, 4, lambda _: None, map, made_scorer())
    names = ("thruster_imbalance", "thrust_scale")
    left = {frozenset(names): 0.3, frozenset(names[:1]): 0.6, frozenset(names[1:]): 0.9}
    left[frozenset()] = 1.0
    for key, value in (("left", left), ("left_out", {}), ("anew", anew)):
        object.__setattr__(search, key, value)
    steps = [Ranking(FIRST, (row(name, SOME.gain),)) for name in names]
    steps, fit = search._backward(steps, search.fit_of(names))
    assert fit.names == (names if stays else names[:1])
    assert [step.best.name for step in steps] == list(fit.names)


def test_what_is_of_a_day_goes_before_what_recordings_left_out_want_of_the_boat() -> None:
    """Beside a wind the compass seems needless; without the wind it is not, and would be gone."""
    nothing: Any = None
    search = Weather(nothing, EFFECTS, 4, lambda _: None, map, made_scorer())
    compass, lift, wind = names = ("compass_deviation", "hull_lift", "steady_wind")
    left = {
        names: 0.3, (lift, wind): 0.301, (compass, lift): 0.301, (compass, wind): 0.9,
        (lift,): 0.302, (compass,): 0.9, (wind,): 0.9,
    }  # fmt: skip
    out = {names: 0.3, (lift, wind): 0.3, (compass, lift): 0.3, (lift,): 0.5}
    object.__setattr__(search, "left", {frozenset(k): v for k, v in left.items()})
    object.__setattr__(search, "left_out", {frozenset(k): v for k, v in out.items()})
    steps = [Ranking(FIRST, (row(name, SOME.gain),)) for name in names]
    assert search._backward(steps, search.fit_of(names))[1].names == (compass, lift)
    object.__setattr__(search, "left_out", {})  # one recording: in the order in which they came
    assert search._backward(steps, search.fit_of(names))[1].names == (lift,)


class InPlace(Weather):
    """What the forces tell in each place: these names, as fits of what is left with them."""

    told: tuple[str, ...] = ()
    asked: list[tuple[str, ...]]

    def _led_by(self, fit: Any, before: Any, added: Any, promising: Any) -> Ranking:
        name = added.effect.name
        return Ranking(fit, (RankedEffect(added.effect, self.fit_of(fit.names), GREAT, 0.5),
                             *(row(n, LITTLE.gain) for n in promising if n != name)))  # fmt: skip


GREAT = Gain(2.0, 0.5, 5.7, 700.0, 0.0)


def in_place(
    monkeypatch: pytest.MonkeyPatch, found: tuple[str, ...], told: str, recordings: int = 1,
    believed: bool = True, looked: tuple[str, ...] = (), nats: dict[str, float] | None = None,
    **left: float,
) -> tuple[tuple[str, ...], list[list[str]]]:  # fmt: skip
    """What stands after the forces have `told` one effect for the last place, and what was asked of
    each place. By `nats` one that ends with an effect is the more likely; else as what is left.
    """
    nothing: Any = None
    search = InPlace(nothing, EFFECTS, 4, lambda _: None, map, made_scorer())
    known = {frozenset(key.split("__")): value for key, value in left.items()}
    object.__setattr__(search, "left", {frozenset(): 1.0, **known})
    asked = []

    def from_forces(_: Any, fit: Any, place: int, effects: Any, mapper: Any) -> list[Any]:
        asked.append([e.name for e in effects])
        names = tuple(n for i, n in enumerate(fit.names) if i != place)
        return [numbered(search.fit_of((*names, told)))] if place == len(found) - 1 else []

    def numbered(fit: Any) -> Any:
        count = sum(len(named(name).fit_parameters) for name in fit.names)
        known = {"": 1e3 * np.log(fit.nrmse)} if nats is None else nats
        fit.unknowns = -6.0 * known.get(fit.names[-1], 0.0) if nats else 6.0 * known[""]
        fit.z = np.zeros(count)
        fit.problem = SimpleNamespace(
            trials=(None,) * recordings, settings=None, deviance=lambda unknowns, z: unknowns
        )
        return fit

    monkeypatch.setattr("sim.diagnosis.likelier.ForceProblem", SimpleNamespace(of=lambda *_: None))
    monkeypatch.setattr("sim.diagnosis.likelier.in_place_by_forces", from_forces)
    monkeypatch.setattr("sim.diagnosis.likelier.fit_under_its_noise", lambda fit, _: fit)
    monkeypatch.setattr(InPlace, "is_believed", lambda self, row, reference: believed)
    steps = [Ranking(FIRST, (row(name, SOME.gain), LITTLE)) for name in found]
    first = Ranking(FIRST, tuple(row(name, SOME.gain) for name in looked))
    rankings, fit = search._in_place_by_forces(first, steps, numbered(search.fit_of(found)))
    assert sorted(r.best.name for r in rankings) == sorted(fit.names)
    return fit.names, asked


LIFT = ("steady_current", "hull_lift")
TOW = ("steady_current", "towed_load")


def test_two_numbers_fewer_take_a_place_where_they_do_as_well(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A tow of two numbers for a lift of four; not where the lift really is better."""
    alike = {"steady_current__hull_lift": 0.2, "steady_current__towed_load": 0.2}
    assert in_place(monkeypatch, LIFT, "towed_load", **alike)[0] == TOW
    assert in_place(monkeypatch, LIFT, "towed_load", believed=False, **alike)[0] == LIFT
    assert in_place(monkeypatch, TOW, "hull_lift", **alike)[0] == TOW
    better = {**alike, "steady_current__hull_lift": 0.15}
    assert in_place(monkeypatch, LIFT, "towed_load", **better)[0] == LIFT
    assert in_place(monkeypatch, TOW, "hull_lift", **better)[0] == LIFT


def test_one_number_fewer_takes_a_place_where_it_is_as_likely(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    tow, loss = TOW, ("steady_current", "advance_loss")
    left = {"steady_current__towed_load": 0.2, "steady_current__advance_loss": 0.2}
    assert in_place(monkeypatch, tow, "advance_loss", **left)[0] == loss
    assert in_place(monkeypatch, loss, "towed_load", **left)[0] == loss
    little = {**left, "steady_current__towed_load": 0.198}
    assert in_place(monkeypatch, tow, "advance_loss", **little)[0] == tow
    assert (
        in_place(monkeypatch, loss, "towed_load", **little)[0] == loss
    )  # too little, for one more


@pytest.mark.parametrize(
    ("ahead", "error", "takes"), [(25.0, 0.202, True), (15.0, 0.202, False), (25.0, 0.3, False)]
)
def test_of_two_with_as_many_numbers_the_more_likely_takes_the_place(
    monkeypatch: pytest.MonkeyPatch, ahead: float, error: float, takes: bool
) -> None:
    """Be its error on unseen time a little larger: each wins that under its own noise."""
    loss, drag = ("steady_current", "advance_loss"), ("steady_current", "cubic_drag")
    left = {"steady_current__advance_loss": 0.2, "steady_current__cubic_drag": error}
    found, _ = in_place(monkeypatch, loss, "cubic_drag", nats={"cubic_drag": ahead}, **left)
    assert found == (drag if takes else loss)


def test_forces_are_asked_for_look_alikes_of_several_causes_of_few_recordings(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    left = {
        "steady_current__advance_loss": 0.2, "steady_current__cubic_drag": 0.2, "hull_lift": 0.2,
        "towed_load": 0.2,
    }  # fmt: skip
    _, asked = in_place(monkeypatch, ("steady_current", "advance_loss"), "cubic_drag", **left)
    assert len(asked) == 2
    assert {"cubic_drag", "towed_load", "cg_offset"} <= set(asked[1])  # the last was promising
    assert not set(asked[1]) & {"steady_current", "current_change", "advance_loss", "hull_lift"}
    seen = in_place(
        monkeypatch, TOW, "cubic_drag", looked=("payload_change", "varying_current"),
        steady_current__towed_load=0.2, **left,
    )[1]  # fmt: skip
    assert all("payload_change" in names for names in seen)  # at the first look alone
    assert not {"varying_current", "current_change"} & set(seen[0])  # what is steady was decided
    assert "varying_current" in seen[1]
    assert in_place(monkeypatch, ("hull_lift",), "towed_load", **left) == (("hull_lift",), [])
    alike = {"steady_current__hull_lift": 0.2, "steady_current__towed_load": 0.2}
    assert in_place(monkeypatch, LIFT, "towed_load", recordings=3, **alike) == (LIFT, [])


class Likely(Weather):
    """How likely each set of effects is, in nats; what comes next is nothing."""

    nats: dict[frozenset[str], float]
    recordings = 1

    def fit_of(self, names: tuple[str, ...]) -> Any:
        fit = super().fit_of(names)
        fit.z = np.zeros(sum(len(named(name).fit_parameters) for name in names))
        fit.unknowns = -6.0 * self.nats.get(frozenset(names), 0.0)
        fit.problem = SimpleNamespace(
            trials=(None,) * self.recordings, block=BLOCK, vessel=WAM_V,
            deviance=lambda unknowns, z: unknowns,
        )  # fmt: skip
        return fit

    def _next(self, steps: Any, fit: Any) -> list[Ranking]:
        return []


def likelier(
    found: tuple[str, ...], nats: dict[str, float], recordings: int = 1, **left: float
) -> set[str]:
    """What stands in the end, given what each set of effects leaves, and how likely it is."""
    nothing: Any = None
    search = Likely(nothing, EFFECTS, 4, lambda _: None, map, made_scorer())
    sets = {frozenset(key.split("__")): value for key, value in left.items()}
    parts = [part for names in (found, *sets) for part in subsets(names)]
    object.__setattr__(search, "left", {**dict.fromkeys(parts, 0.9), **sets})
    ahead = {frozenset(key.split("__")): value for key, value in nats.items()}
    object.__setattr__(search, "nats", ahead)
    object.__setattr__(search, "recordings", recordings)
    steps = [Ranking(FIRST, (row(name, SOME.gain),)) for name in found]
    rankings, fit = search._more_likely(steps[0], steps, search.fit_of(found))
    assert tuple(r.best.name for r in rankings) == fit.names
    return set(fit.names)


def subsets(names: Collection[str]) -> list[frozenset[str]]:
    """All of them that lack one or two of the names, or more."""
    return [frozenset(some) for k in range(len(names)) for some in combinations(names, k)]


BENT = ("current_change", "hull_lift", "wind_change")  # a lift beside a wind that it bent
BLEW = ("current_change", "wind_change")


def test_one_wind_takes_the_place_of_two_effects_where_it_is_more_likely() -> None:
    left = {"current_change__hull_lift__wind_change": 0.2, "current_change__wind_change": 0.19}
    bent, blew = left
    assert likelier(BENT, {blew: 20.0}, **left) == set(BLEW)
    assert likelier(BENT, {bent: 30.0}, **left) == set(BENT)
    worse = {**left, blew: 0.25}  # what is more likely must predict as well
    assert likelier(BENT, {blew: 20.0}, **worse) == set(BENT)
    assert likelier(BENT, {blew: 20.0}, **{**left, bent: 0.08}) == set(BENT)  # only noise is left
    assert likelier(BENT, {blew: 20.0}, recordings=3, **left) == set(BENT)


def test_another_takes_the_place_of_one_by_many_nats_but_not_its_general_form() -> None:
    left = {"steady_wind__advance_loss": 0.2, "steady_wind__cubic_drag": 0.2,
            "wind_change__advance_loss": 0.2}  # fmt: skip
    found = ("steady_wind", "advance_loss")
    drag = {"steady_wind", "cubic_drag"}
    assert likelier(found, {"steady_wind__cubic_drag": 25.0}, **left) == drag
    assert likelier(found, {"steady_wind__cubic_drag": 15.0}, **left) == set(found)
    assert likelier(found, {"wind_change__advance_loss": 50.0}, **left) == set(found)
    alone = {"advance_loss": 0.2, "cubic_drag": 0.2}
    assert likelier(("advance_loss",), {"cubic_drag": 50.0}, **alone) == {"advance_loss"}


def next_two(most: int = 4, recordings: int = 1, believed: bool = True, **left: float) -> list[str]:
    """What comes beside a strong current, none of the others alone being more than its form."""
    nothing: Any = None

    class Hidden(Weather):
        def rank(
            self, fit: Any, closer: bool = False, among: Container[str] | None = None,
            present: Any = None,
        ) -> Ranking:  # fmt: skip
            names = {n for key in self.left for n in key} - {*fit.names}
            ranking = super().rank(fit, among=names)
            for each in ranking.finalists:
                each.fit.problem.trials = (None,) * recordings
            return ranking

        def is_believed(self, row: Any, reference: Any) -> bool:
            return believed

        def _others(self, fit: Any) -> list[Effect]:
            return [named("steady_wind"), named("payload_change")]

        def helps(self, before: Any, after: Any) -> bool:
            return bool(after.nrmse < before.nrmse)

    search = Hidden(nothing, EFFECTS, most, lambda _: None, map, made_scorer())
    known = {frozenset(key.split("__")): value for key, value in left.items()}
    object.__setattr__(search, "left", {frozenset(): 1.0, **known})
    current = search.fit_of(("current_change",))
    current.problem.trials = (None,) * recordings
    steps = [Ranking(FIRST, (row("current_change", Gain(9.0, 2.0, 9.0, 1e5, 0.0)),))]
    return [r.best.name for r in search._next(steps, current)]


HIDING = {
    "current_change": 0.3, "current_change__payload_change": 0.27,
    "current_change__steady_wind": 0.28, "current_change__payload_change__steady_wind": 0.06,
}  # fmt: skip


def test_two_that_hide_each_other_come_together() -> None:
    assert next_two(**HIDING) == ["payload_change", "steady_wind"]


def test_two_come_together_only_where_the_second_is_more_than_form_and_there_is_room() -> None:
    form = {**HIDING, "current_change__payload_change__steady_wind": 0.26}
    assert next_two(**form) == []
    assert next_two(most=2, **HIDING) == []
    assert next_two(recordings=3, **HIDING) == []
    assert next_two(believed=False, **HIDING) == []
    noise = {key: 0.2 * value for key, value in HIDING.items()}
    assert next_two(**noise) == []
