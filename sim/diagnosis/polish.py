"""The last fit of a ladder once more, as `shadow identify` fits: its numbers are those that stay.

    moments of events, once;   then starts → noise → numbers in turn until they settle

While effects are compared, starts are taken from the measured motion and noise from a leader, the
same for all. Numbers that are told with an interval deserve starts where this model has them, and
the noise that it leaves.
"""

from dataclasses import replace

from sim.diagnosis.events import at_its_moment, moments_in
from sim.diagnosis.fit import Fit
from sim.diagnosis.ground import Ground
from sim.diagnosis.ranking import BLOCK
from sim.identification.shooting import residuals_of, shoot


def polished(fit: Fit) -> Fit:
    """The same effects with their last numbers; the ground is that of the new fit."""
    for name in moments_in(fit):
        fit = at_its_moment(fit, name)
    ground, unknowns = fit.ground, fit.unknowns
    trials, settings = ground.trials, ground.settings
    last = replace(settings, horizons=settings.horizons[-1:])
    shot = shoot(unknowns, trials, [t.usable for t in trials], last, fit.z)
    own = Ground.of(
        ground.vessel, trials, unknowns, shot.z, shot.noise, settings, BLOCK, shot.voyages
    )
    return Fit(
        fit.added, unknowns, own, shot.z, residuals_of(unknowns, own.windows, shot.z[None])[0]
    )
