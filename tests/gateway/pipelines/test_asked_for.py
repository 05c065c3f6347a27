"""A recording asks for a manoeuvre, or says in one line why it cannot."""

import pytest

from gateway.errors import BadInput
from gateway.offline.plan import rank_manoeuvres
from sim.prediction.free_runs import DivergedError
from tests.sim.voyages import WAM_V, simulated


def test_a_model_that_no_prediction_can_be_made_with_is_bad_input(monkeypatch):
    def lost(*_):
        raise DivergedError("plain diverges at once from every start")

    monkeypatch.setattr("gateway.offline.trials.load_trials", lambda *_: [simulated(WAM_V)])
    monkeypatch.setattr("gateway.offline.diagnose.diagnose", lost)
    with pytest.raises(BadInput, match=r"a\.tlog: plain diverges"):
        rank_manoeuvres("a.tlog", WAM_V)


def test_a_recording_too_short_to_ask_for_anything_is_bad_input(monkeypatch):
    short = [simulated(WAM_V, 10.0)]
    monkeypatch.setattr("gateway.offline.trials.load_trials", lambda *_: short)
    with pytest.raises(BadInput, match=r"a\.tlog: .* s of usable time"):
        rank_manoeuvres("a.tlog", WAM_V)
