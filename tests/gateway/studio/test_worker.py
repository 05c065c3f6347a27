"""Long work lives in a process of its own: told about, failed in a sentence, ended at will."""

import os
import time

import pytest

from gateway.studio.worker import Worker, answer
from tests.gateway.studio import chores


@pytest.fixture(scope="module")
def worker():
    with Worker() as one:
        yield one


def all_news(worker: Worker, patience_s: float = 30.0):
    end, found = time.monotonic() + patience_s, []
    while worker.busy and time.monotonic() < end:
        found += worker.news()
        time.sleep(0.01)
    return found


def test_progress_parts_and_the_result_arrive_in_order(worker):
    worker.start("job", chores.double, 21)
    found = all_news(worker)
    assert [(n.job, n.kind) for n in found] == [
        ("job", "progress"), ("job", "part"), ("job", "done"),
    ]  # fmt: skip
    assert found[-1].value == 42
    assert not worker.busy


def test_it_is_another_process_and_stays_the_same_one(worker):
    seen = []
    for _ in range(2):
        worker.start("who", chores.process)
        seen.append(all_news(worker)[-1].value)
    assert seen[0] == seen[1] != os.getpid()


def test_it_steps_back_behind_what_has_to_keep_a_rate(worker):
    worker.start("nice", chores.niceness)
    assert all_news(worker)[-1].value > os.nice(0)


def test_what_goes_wrong_is_one_line_without_a_traceback(worker, capsys):
    worker.start("job", chores.refuse)
    assert all_news(worker)[-1].value == "no such boat"
    worker.start("job", chores.stumble)
    says = all_news(worker)[-1]
    assert says.kind == "failed"
    assert "inside" not in says.value
    assert "\n" not in says.value
    assert answer(chores.stumble, (), print) == ("failed", says.value)
    assert "Traceback" in capsys.readouterr().err  # the log has it


def test_one_job_at_a_time(worker):
    worker.start("first", chores.sleep)
    with pytest.raises(RuntimeError, match="busy with first"):
        worker.start("second", chores.double, 1)
    worker.cancel()


def test_cancelled_work_is_gone_at_once_and_the_next_job_runs(worker):
    worker.start("long", chores.sleep)
    while worker.says != "asleep":
        worker.news()
    begun = time.monotonic()
    worker.cancel()
    assert time.monotonic() - begun < 5.0
    worker.start("job", chores.double, 1)
    assert all_news(worker)[-1].value == 2


def test_a_process_that_dies_is_said_and_replaced(worker):
    worker.start("job", chores.die)
    assert all_news(worker)[-1].kind == "failed"
    worker.start("job", chores.double, 3)
    assert all_news(worker)[-1].value == 6
