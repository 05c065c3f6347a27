"""What a fit is worth on blocks of time that it did not see.

Each fourth block is held out in turn, 5 s to either side of it with it. The fit without them is
one damped Gauss–Newton step from the fit with them; the model then really runs over the blocks. A
gain is a ratio of squared errors per block: thousands of samples make everything significant, so
what counts is how large it is, and how alike from block to block. Beside it stands the error that
`compare` prints: free runs of 10 s under one ruler for every step of a ladder, each block predicted
with the numbers of the fit that did not see it. It is the ruler of the vessel as given, or of a fit
that leaves no more than noise and predicts better by its own: by the ruler of a hull that holds its
course the true model of one that does not seems to err far above the noise.

How probable each explanation is: stacking of held-out blocks, drawn again and again.

    w = E over π of softmax( ln p + G Σ_b π_b s_b ),     π ~ Dirichlet(1, …, 1),     s_b = −½ Σ e²

s_b is the held-out log score of block b. Drawing blocks anew (pseudo-BMA+: Yao, Vehtari, Simpson
and Gelman, Bayesian Analysis 13, 2018) keeps one lucky block from deciding. Errors within a block
are more alike than the whitening says: several rows count as one. p is the prior: an effect has to
win `CATALOGUE_PRIOR_NATS` to be as probable as that nothing is missing.

**Ranking**: the whole catalogue beside the effects found so far, by what explains most of held-out
time.

    screen all → noise as the most promising leaves it → fit the few → held-out blocks → order

The noise is that of the most promising explanation, which is the one that the screening finds most
likely under the noise that it leaves itself. Estimated from what the reference leaves, it would
take the very thing that is looked for as a slow error of the sensors, and forgive it.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from sim.comparison.compare import Judgement, judge
from sim.diagnosis import thresholds
from sim.diagnosis.fit import Fit, fit_effects, from_given_base
from sim.diagnosis.fit_problem import FitProblem, SupersetModel
from sim.diagnosis.screening import Mapper, most_promising, screen
from sim.diagnosis.screening_steps import ScreeningResult
from sim.effects.effect import Effect
from sim.model import Model
from sim.prediction.free_runs import Ruler, nrmse_interval, predict, scaled_squares
from sim.prediction.segments import CompareSettings, NoUsableTimeError
from sim.state import Floats, Ints, Progress
from sim.trial import Trial
from sim.vessel import AddedEffect


class Gain(NamedTuple):
    """Of one fit over another, on held-out time.

    ratio      of the squared errors, before / after
    log_ratio  mean over the blocks of the log of that ratio
    t          of that mean
    nats       of log likelihood, several rows counting as one
    lost       of the nats, per nat won in other blocks
    """

    ratio: float
    log_ratio: float
    t: float
    nats: float
    lost: float


def _squares(residual: Floats) -> Floats:
    """Squares (N,), none beyond its clip."""
    return np.asarray(np.clip(residual, -thresholds.CLIP_SIGMAS, thresholds.CLIP_SIGMAS) ** 2)


def per_block(residual: Floats, block: Ints) -> Floats:
    """Sum of squares of each block (G,), no row beyond its clip."""
    return np.asarray(np.bincount(block, _squares(residual)), np.float64)


def nats_won(before: Floats, after: Floats) -> Floats:
    """Nats (N,) that each residual of a fit wins over those of another, clipped."""
    won = _squares(before) - _squares(after)
    return np.asarray(0.5 * won / thresholds.ROWS_PER_INDEPENDENT_ROW)


def gain(before: Floats, after: Floats, block: Ints) -> Gain:
    """Residuals (N,) of two fits -> what the second is worth."""
    a, b = per_block(before, block), per_block(after, block)
    log = np.log(np.maximum(a, 1e-9) / np.maximum(b, 1e-9))
    spread = float(log.std(ddof=1)) if len(log) >= thresholds.MIN_BLOCKS_FOR_T else np.inf
    t = float(log.mean() / max(spread / np.sqrt(len(log)), 1e-9))
    won = np.bincount(block, nats_won(before, after))
    up, down = float(np.maximum(won, 0.0).sum()), float(np.maximum(-won, 0.0).sum())
    ratio = max(float(a.sum()), 1e-300) / max(float(b.sum()), 1e-300)
    return Gain(ratio, float(log.mean()), t, up - down, down / max(up, 1e-9))


def gain_under(problem: FitProblem, before: Fit, after: Fit, mapper: Mapper = map) -> Gain:
    """What a fit is worth over another, both fitted anew under the noise of one problem."""

    def unseen(fit: Fit) -> Floats:
        return fit_effects(fit.added, fit.unknowns, problem, fit.z).heldout_residual

    a, b = mapper(unseen, (before, after))
    return gain(a, b, problem.block)


def gain_on_recordings(before: Fit, after: Fit) -> Gain | None:
    """What a fit is worth over another on recordings that neither has seen, each left out in turn.

    None where there are fewer than `MIN_RECORDINGS`. Both on one problem. Blocks of a recording
    that was fitted share its day with those that were not: they cannot tell what is true of a boat
    from what is true of a day.
    """
    if len(before.problem.trials) < thresholds.MIN_RECORDINGS:
        return None
    trial = before.problem.places.trial
    return gain(before.left_out_residual, after.left_out_residual, trial)


@dataclass(frozen=True)
class HeldOutScore:
    """nrmse with its 95 % interval (None on a single block)."""

    nrmse: float
    ci95: tuple[float, float] | None


@dataclass(frozen=True)
class HeldOutScorer:
    """The rulers of all trials; None of a trial too short.

    first  the vessel as it was given
    error  nrmse, by these rulers, of the vessel whose they are
    """

    trials: tuple[Trial, ...]
    rulers: tuple[Ruler | None, ...]
    first: Model
    error: float

    @classmethod
    def of(cls, trials: Sequence[Trial], first: Model) -> "HeldOutScorer":
        """The rulers of the vessel as it was given; NoUsableTimeError where no trial has a stretch
        to compare over.
        """
        rulers = tuple(_ruler(trial, first) for trial in trials)
        if all(ruler is None for ruler in rulers):
            raise NoUsableTimeError("no stretch of usable time is long enough to compare over")
        scorer = cls(tuple(trials), rulers, first, np.inf)
        return replace(scorer, error=scorer.given)

    def shared_with(self, fit: Fit) -> "HeldOutScorer":
        """With the rulers of a fit that predicts better by them than the vessel whose rulers these
        are does by these; else as it is (see `sim.prediction.free_runs.shared_ruler`).

        Only of a fit that leaves no more than noise from one moment to the next, and is not so
        unstable that noise hides the motion: how fast errors grow on a boat is not known from a
        model that is not hers.
        """
        if not _is_noise_but_for_gusts(fit.noise_share):
            return self
        model = fit.unknowns.model
        rulers = tuple(
            _ruler(trial, replace(model, theta=fit.unknowns.theta(fit.z[None], i)[0]))
            for i, trial in enumerate(self.trials)
        )
        own = replace(self, rulers=rulers)
        error = own.score_fit(fit).nrmse
        if error >= self.error or judge(error, own.noise_floor) is Judgement.UNJUDGED:
            return self
        return replace(own, error=error)

    @property
    def given(self) -> float:
        """nrmse of the vessel as it was given."""
        return self.score_model(self.first).nrmse

    @property
    def noise_floor(self) -> float:
        """nrmse that a perfect model would show."""
        return float(np.sqrt(np.mean([r.noise_floor**2 for r in self.rulers if r is not None])))

    def score_model(self, model: Model) -> HeldOutScore:
        """A vessel that was not fitted: all of its time is held out."""
        return _pooled([self._squares(i, [model]) for i in range(len(self.trials))])

    def score_fit(self, fit: Fit, changed: Callable[[Floats], Floats] = np.array) -> HeldOutScore:
        """A fit, each block by the fit without it; `changed`: parameters (P,) -> those to score."""
        model = fit.unknowns.model
        return _pooled([
            self._squares(
                i,
                [replace(model, theta=changed(t))
                 for t in fit.unknowns.theta(fit.fold_fits.z, i)],
                fit.problem.fold_at(i, trial.time),
            )
            for i, trial in enumerate(self.trials)
        ])  # fmt: skip

    def score_recordings(self, fit: Fit) -> HeldOutScore | None:
        """A fit, each trial by the fit without it; None of fewer than `MIN_RECORDINGS` trials."""
        count, model = len(self.trials), fit.unknowns.model
        if count < thresholds.MIN_RECORDINGS:
            return None
        theta = [fit.unknowns.theta(fit.recording_fits.z, i)[i] for i in range(count)]
        return _pooled([self._squares(i, [replace(model, theta=t)]) for i, t in enumerate(theta)])

    def _squares(
        self, trial: int, models: Sequence[Model], fold: Ints | None = None
    ) -> tuple[Floats, Floats]:
        """Scaled squared errors (M,) and a label of the block of each (M,)."""
        ruler = self.rulers[trial]
        if ruler is None:
            return np.zeros(0), np.zeros(0)
        squares, labels = [], []
        for k, model in enumerate(models):
            mine = ruler if fold is None else ruler.subset(fold[ruler.segments.rows] == k)
            if len(mine.segments.rows):
                segment, _, error = predict(self.trials[trial], model, mine).predicted_rows()
                squares.append(scaled_squares(error, ruler.scales))
                labels.append(1e6 * trial + mine.blocks[segment])
        return np.concatenate(squares), np.concatenate(labels)


def _is_noise_but_for_gusts(noise_share: tuple[float, float, float]) -> bool:
    """Whether no more is left than is stated as noise, and in turning what gusts add, which
    `worth.is_at_floor` does not allow for.
    """
    u, v, r = noise_share
    return max(u, v) < thresholds.MAX_NOISE_SHARE and r < thresholds.MAX_NOISE_SHARE_OF_TURN


def _ruler(trial: Trial, first: Model) -> Ruler | None:
    try:
        return Ruler.of(trial, first, CompareSettings())
    except NoUsableTimeError:
        return None


def _pooled(parts: Sequence[tuple[Floats, Floats]]) -> HeldOutScore:
    squares = np.concatenate([s for s, _ in parts])
    labels = np.unique(np.concatenate([b for _, b in parts]), return_inverse=True)[1]
    return HeldOutScore(float(np.sqrt(squares.mean())), nrmse_interval(squares, labels, 1))


def probabilities(blocks: Floats, seed: int = 1) -> Floats:
    """Held-out squared errors (M, G) by block, nothing added first -> probabilities (M,)."""
    score = -0.5 * blocks / thresholds.ROWS_PER_INDEPENDENT_ROW
    count = blocks.shape[1]
    draw = np.random.default_rng(seed).dirichlet(np.ones(count), thresholds.POSTERIOR_DRAWS)
    total = count * draw @ score.T
    total[:, 1:] -= thresholds.CATALOGUE_PRIOR_NATS
    total -= total.max(axis=1, keepdims=True)
    weight = np.exp(total)
    return np.asarray((weight / weight.sum(axis=1, keepdims=True)).mean(axis=0))


@dataclass(frozen=True)
class RankedEffect:
    """One effect beside the reference: fitted, and its gain on held-out time."""

    effect: Effect
    fit: Fit
    gain: Gain
    probability: float

    @property
    def name(self) -> str:
        """Of the effect."""
        return self.effect.name

    @property
    def found(self) -> AddedEffect:
        """With its numbers, as on the first trial."""
        return AddedEffect(self.effect, self.fit.values(self.name))

    def gain_over(self, other: "RankedEffect") -> Gain:
        """What this one is worth over another of the same ranking."""
        before, after = other.fit.heldout_residual, self.fit.heldout_residual
        return gain(before, after, self.fit.problem.block)


@dataclass(frozen=True)
class Ranking:
    """The reference and all finalists on one fit problem, the best first; perhaps none."""

    reference: Fit
    finalists: tuple[RankedEffect, ...]

    @property
    def best(self) -> RankedEffect:
        """The first."""
        return self.finalists[0]

    def led_by(self, row: RankedEffect) -> "Ranking":
        """The same with one of the finalists before the others."""
        return replace(self, finalists=(row, *(r for r in self.finalists if r is not row)))


def rank(
    superset: SupersetModel, model: Model, effects: Iterable[Effect], reference: Fit,
    progress: Progress = lambda _: None, mapper: Mapper = map, closer: bool = False,
    rival: Fit | None = None, present: Fit | None = None,
) -> Ranking:  # fmt: skip
    """All effects beside those of the reference, each with everything fitted anew.

    closer: those that declare further starts are fitted from each of them; rival, present: see
    `screen`.
    """
    results = screen(superset, model, effects, reference, progress, mapper, closer, rival, present)
    if not results:
        return Ranking(reference, ())
    results = select_finalists(results)
    name = results[0].name
    leader: ScreeningResult | Fit = results[0]
    for _ in range(thresholds.MAX_NOISE_ROUNDS):
        progress(f"fitting {', '.join(r.name for r in results)}")
        ranking = _rank_finalists(reference, results, leader, mapper)
        if ranking.best.name == name or ranking.best.gain.nats < thresholds.MIN_NATS_OF_A_LEADER:
            break
        name, leader = ranking.best.name, ranking.best.fit
    return ranking


def ranked_over(reference: Fit, fit: Fit) -> RankedEffect:
    """The last effect of a fit, on the problem of a reference without it."""
    before, after, block = reference.heldout_residual, fit.heldout_residual, fit.problem.block
    chance = probabilities(np.array([per_block(r, block) for r in (before, after)]))[1]
    return RankedEffect(fit.added[-1].effect, fit, gain(before, after, block), float(chance))


def select_finalists(results: Sequence[ScreeningResult]) -> list[ScreeningResult]:
    """Those worth a whole fit."""
    return most_promising(
        results, thresholds.MIN_FINALISTS, thresholds.MAX_FINALISTS, thresholds.MIN_PROMISE
    )


def _rank_finalists(
    reference: Fit, results: Sequence[ScreeningResult], leader: Fit | ScreeningResult,
    mapper: Mapper,
) -> Ranking:  # fmt: skip
    """The finalists under the noise that one of them leaves."""
    noise = reference.problem.noise_of(leader.unknowns, leader.z)
    problem = reference.problem_under(noise, leader)

    def whole(r: ScreeningResult | None) -> tuple[Fit, Floats]:
        """With one of them, or none, and what is left of held-out time."""
        if r is None:
            fit = fit_effects(reference.added, reference.unknowns, problem, reference.z)
            return fit, fit.heldout_residual
        added = (*reference.added, r.added)
        again = None
        if reference.added:  # the first look has begun from the base as given itself
            again = from_given_base(added, r.unknowns, problem, r.z)
        starts = [r.z] if again is None else [r.z, again]
        fits = (fit_effects(added, r.unknowns, problem, z) for z in starts)
        fit = min(fits, key=lambda f: f.cost)
        return fit, fit.heldout_residual

    (before, without), *fitted = mapper(whole, [None, *results])
    residuals = [without, *(left for _, left in fitted)]
    chance = probabilities(np.array([per_block(r, problem.block) for r in residuals]))[1:]
    rows = [
        RankedEffect(fit.added[-1].effect, fit, gain(without, left, problem.block), float(p))
        for (fit, left), p in zip(fitted, chance, strict=True)
    ]
    rows.sort(key=lambda r: -r.gain.ratio)
    return Ranking(before, _special_first(rows))


def _special_first(rows: list[RankedEffect]) -> tuple[RankedEffect, ...]:
    """A general effect steps behind its special case where that does as well."""
    for i, row in enumerate(rows):
        special = next((r for r in rows[i + 1 :] if r.name == row.effect.general_of), None)
        if special is not None and not is_better_than_special(row.gain_over(special)):
            rows.remove(special)
            rows.insert(i, special)
    return tuple(rows)


def is_better_than_special(more: Gain) -> bool:
    """Whether what a general effect is worth over its special case is more than chance."""
    small = more.log_ratio < thresholds.MIN_LOG_RATIO_BETTER
    return not (small or more.t < thresholds.MIN_T_BETTER)
