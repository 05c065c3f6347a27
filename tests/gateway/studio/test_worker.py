"""Long work in a process of its own: progress, failure in a sentence, ended at any moment."""

import os
import time

import pytest

from gateway.studio.worker import Worker, outcome
from tests.gateway.studio import jobs


@pytest.fixture(scope="module")
def worker():
    with Worker() as one:
        yield one


def all_messages(worker: Worker, patience_s: float = 30.0):
    end, found = time.monotonic() + patience_s, []
    while worker.busy and time.monotonic() < end:
        found += worker.messages()
        time.sleep(0.01)
    return found


def test_progress_parts_and_the_result_arrive_in_order(worker):
    worker.start("job", jobs.double, 21)
    found = all_messages(worker)
    assert [(n.job, n.kind) for n in found] == [
        ("job", "progress"), ("job", "part"), ("job", "done"),
    ]  # fmt: skip
    assert found[-1].value == 42
    assert not worker.busy


def test_it_is_another_process_and_stays_the_same_one(worker):
    seen = []
    for _ in range(2):
        worker.start("who", jobs.process)
        seen.append(all_messages(worker)[-1].value)
    assert seen[0] == seen[1] != os.getpid()


def test_it_steps_back_behind_what_has_to_keep_a_rate(worker):
    worker.start("nice", jobs.niceness)
    assert all_messages(worker)[-1].value > os.nice(0)


def test_what_goes_wrong_is_one_line_without_a_traceback(worker, capsys):
    worker.start("job", jobs.refuse)
    assert all_messages(worker)[-1].value == "no such boat"
    worker.start("job", jobs.stumble)
    message = all_messages(worker)[-1]
    assert message.kind == "failed"
    assert "inside" not in message.value
    assert "\n" not in message.value
    assert outcome(jobs.stumble, (), print) == ("failed", message.value)
    assert "Traceback" in capsys.readouterr().err  # the log has it


def test_one_job_at_a_time(worker):
    worker.start("first", jobs.sleep)
    with pytest.raises(RuntimeError, match="busy with first"):
        worker.start("second", jobs.double, 1)
    worker.cancel()


def test_cancelled_work_is_gone_at_once_and_the_next_job_runs(worker):
    worker.start("long", jobs.sleep)
    while worker.progress != "asleep":
        worker.messages()
    begun = time.monotonic()
    worker.cancel()
    assert time.monotonic() - begun < 5.0
    worker.start("job", jobs.double, 1)
    assert all_messages(worker)[-1].value == 2


@pytest.mark.slow
def test_a_process_that_dies_is_reported_and_replaced(worker):
    worker.start("job", jobs.die)
    assert all_messages(worker)[-1].kind == "failed"
    worker.start("job", jobs.double, 3)
    assert all_messages(worker)[-1].value == 6
