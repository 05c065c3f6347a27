"""A fleet's run: every recording one row, nothing twice, and a whole table however it ends."""

import os
import shutil
from pathlib import Path

import fsspec
import pyarrow.parquet as pq
import pytest
from distributed import LocalCluster
from fsspec.implementations.memory import MemoryFileSystem
from pymavlink.dialects.v20 import ardupilotmega as dialect

from gateway.errors import BadInput, ShadowError
from gateway.files import RECORDINGS
from gateway.fleet import fleet_of_one, read_fleet
from gateway.fleet import run as running
from gateway.fleet.analysis import DAY_S, AnalysisSettings, Task, analyse
from gateway.fleet.run import FleetResult, Progress, local_cluster, run_fleet
from gateway.fleet.table import read_estimates, read_recordings
from tests.gateway.ingest.scripted import START_NS
from tests.gateway.pipelines.sailing import BOOT_S, frames, parameters, voyage

COMPARE = AnalysisSettings(steps=("compare",))


def go(folder: Path, cluster: LocalCluster, settings=COMPARE, **more) -> FleetResult:
    return run_fleet(
        [str(folder / "logs")], read_fleet(folder / "fleet.toml"), folder / "out", settings,
        scheduler=cluster.scheduler_address, **more,
    )  # fmt: skip


def states(folder: Path) -> dict[str, str]:
    return {Path(r["recording"]).stem: r["state"] for r in read_recordings(folder / "out")}


def test_every_recording_is_one_row_and_a_bad_one_says_why(folder, cluster):
    go(folder, cluster)
    assert states(folder) == {
        "monday": "done", "tuesday": "done", "short": "failed", "stray": "failed",
    }  # fmt: skip
    rows = {Path(r["recording"]).stem: r for r in read_recordings(folder / "out")}
    assert rows["stray"]["why"] == "no entry of the fleet file names it"
    assert "no servo outputs" in rows["short"]["why"]
    monday = rows["monday"]
    assert monday["boat"] == "heron"
    assert 30.0 < monday["usable_s"] <= 40.0
    assert 0.0 < monday["nrmse"] < 10.0
    assert monday["distance_m"] == pytest.approx(
        monday["usable_s"] * monday["top_speed_mps"], rel=0.9
    )
    assert monday["why"] is None


def test_identify_writes_numbers_with_intervals(folder, cluster):
    shutil.rmtree(folder / "logs" / "heron")
    (folder / "logs" / "stray.tlog").rename(folder / "logs" / "otter_1.tlog")
    go(folder, cluster, AnalysisSettings(steps=("identify",)))
    rows = {row["name"]: row for row in read_estimates(folder / "out")}
    assert {"X_u", "N_r", "left.ahead", "right.ahead"} <= rows.keys()
    assert not {"m11", "m22", "m33"} & rows.keys()
    assert all(r["low"] <= r["value"] <= r["high"] for r in rows.values())
    assert {r["boat"] for r in rows.values()} == {"otter-1"}


@pytest.mark.parametrize("years", [0, 5, -50])
def test_a_clock_that_is_years_off_is_set_by_the_boats(folder, cluster, years):
    now_us = START_NS // 1000
    boats = dialect.MAVLink_system_time_message(now_us, round(1000 * BOOT_S))
    said = [(0.0, boats), *parameters(), *voyage(40.0)]
    off_us = round(years * 365.25 * DAY_S * 1e6)
    late = b"".join(
        (int.from_bytes(frame[:8], "big") + off_us).to_bytes(8, "big") + frame[8:]
        for frame in frames(said)
    )
    shutil.rmtree(folder / "logs" / "heron")
    (folder / "logs" / "heron").mkdir()
    (folder / "logs" / "heron" / "late.tlog").write_bytes(late)
    go(folder, cluster)
    (row,) = (r for r in read_recordings(folder / "out") if r["state"] == "done")
    assert abs(row["started"].timestamp() - START_NS * 1e-9) < 5.0
    told = [n for n in row["notices"] if "dated by the boat's" in n]
    words = {5: "its clock is 1826 days ahead of", -50: "its clock is 18262 days behind"}
    assert len(told) == (years != 0)
    assert all(n.startswith(words[years]) for n in told)


def test_what_is_known_is_not_run_again_until_it_changes(folder, cluster, monkeypatch):
    go(folder, cluster)
    (folder / "logs" / "heron" / "monday.tlog").rename(folder / "logs" / "heron" / "renamed.tlog")
    again = go(folder, cluster)
    assert again.known == 3
    assert states(folder).keys() == {"renamed", "tuesday", "short", "stray"}
    with (folder / "boat.toml").open("a") as file:
        file.write("\n# edited\n")
    assert go(folder, cluster).known == 0
    assert go(folder, cluster, AnalysisSettings(steps=("compare",), anyway=True)).known == 0
    with (folder / "logs" / "heron" / "tuesday.tlog").open("ab") as file:
        file.write(b"\0" * 40)
    assert go(folder, cluster).known == 2


def test_failures_are_run_again_when_asked(folder, cluster):
    go(folder, cluster)
    assert go(folder, cluster, retry=True).known == 2


def test_workers_run_without_dasks_profiler(cluster):
    """It keeps every second's stacks: half a gigabyte within three hundred recordings."""
    for worker in cluster.workers.values():
        assert "profile" not in worker.periodic_callbacks


def test_a_copy_is_told_as_one(folder, cluster):
    logs = folder / "logs" / "heron"
    shutil.copy(logs / "monday.tlog", logs / "zz.tlog")
    go(folder, cluster)
    row = next(r for r in read_recordings(folder / "out") if r["recording"].endswith("zz.tlog"))
    assert (row["state"], row["nrmse"]) == ("duplicate", None)
    assert row["why"].endswith("monday.tlog")


def test_a_name_that_is_no_text_has_its_row(folder, cluster):
    logs = folder / "logs" / "heron"
    shutil.copy(logs / "monday.tlog", logs / os.fsdecode(b"z\xff.tlog"))
    go(folder, cluster)
    assert any(r["recording"].endswith("z\\xff.tlog") for r in read_recordings(folder / "out"))
    assert go(folder, cluster).dropped == []


def test_an_interrupt_leaves_a_whole_table_and_the_next_run_goes_on(folder, cluster):
    def interrupt(now: Progress) -> None:
        if now.worked == 1:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        go(folder, cluster, progress=interrupt)
    assert len(pq.read_table(folder / "out" / "recordings.parquet")) == 2  # the stray, and one
    assert go(folder, cluster).known == 1
    assert len(states(folder)) == 4


def test_a_line_that_was_cut_off_costs_that_line_alone(folder, cluster):
    go(folder, cluster)
    file = folder / "out" / "results.jsonl"
    file.write_bytes(file.read_bytes()[:-30])
    assert go(folder, cluster).known == 2
    assert go(folder, cluster).known == 3


def test_progress_counts_up_and_says_what_is_left(folder, cluster):
    seen: list[Progress] = []
    go(folder, cluster, progress=seen.append)
    assert [one.done for one in seen] == [1, 2, 3, 4]
    assert {one.total for one in seen} == {4}
    assert seen[0].seconds_left is None
    assert seen[-2].seconds_left > 0.0
    assert (seen[-1].seconds_left, seen[-1].failed) == (0.0, 2)


def test_a_url_is_read_where_the_worker_is(folder, cluster):
    boats = read_fleet(folder / "fleet.toml")
    url = f"file://{folder}/logs/heron"
    run_fleet([url], boats, folder / "out", COMPARE, scheduler=cluster.scheduler_address)
    rows = read_recordings(folder / "out")
    assert [row["state"] for row in rows] == ["done", "done"]
    assert all(row["recording"].startswith("file:///") for row in rows)


def test_a_filesystem_that_is_no_disk_is_read_through_fsspec(folder, cluster, sailed):
    memory = fsspec.filesystem("memory")  # the cluster's workers are in this process
    memory.pipe({"/lake/heron/a.tlog": sailed, "/lake/notes.txt": b"no recording"})
    memory.pipe("/torn/heron/torn.tlog", b"no recording")
    boats = read_fleet(folder / "fleet.toml")
    try:
        for named in ("memory://lake", "memory://lake/heron/*.tlog"):
            run_fleet([named], boats, folder / "out", COMPARE, scheduler=cluster.scheduler_address)
            (row,) = read_recordings(folder / "out")
            assert (row["state"], row["boat"]) == ("done", "heron")
            assert row["recording"] == "memory:///lake/heron/a.tlog"
        torn = ["memory://torn"]
        run_fleet(torn, boats, folder / "out", COMPARE, scheduler=cluster.scheduler_address)
        (row,) = read_recordings(folder / "out")
        assert row["why"].startswith("memory:///torn/heron/torn.tlog is a text file")
        with pytest.raises(BadInput, match=r"memory://lake/b\.tlog: there is no such file"):
            run_fleet(["memory://lake/b.tlog"], boats, folder / "out", COMPARE)
    finally:
        memory.rm("/lake", recursive=True)
        memory.rm("/torn", recursive=True)


class NoCredentials(Exception):
    """Of a filesystem's package: none of Python's own."""


def test_errors_of_a_filesystems_own_are_one_line_or_a_row(folder, cluster, monkeypatch):
    boats = read_fleet(folder / "fleet.toml")

    def refuse(*_, **more):
        raise NoCredentials("Unable to locate credentials")

    with monkeypatch.context() as patched:
        patched.setattr(MemoryFileSystem, "isdir", refuse)
        with pytest.raises(BadInput, match="memory://sea: cannot look there: Unable to locate"):
            run_fleet(["memory://sea"], boats, folder / "out", COMPARE)
    memory = fsspec.filesystem("memory")
    memory.pipe("/sea/heron/a.tlog", b"locked")
    monkeypatch.setattr(MemoryFileSystem, "_open", refuse)
    run_fleet(["memory://sea"], boats, folder / "out", COMPARE, scheduler=cluster.scheduler_address)
    (row,) = read_recordings(folder / "out")
    assert (row["state"], row["sha256"]) == ("failed", "")
    assert row["why"].endswith("cannot be read: Unable to locate credentials")
    memory.rm("/sea", recursive=True)


def test_what_is_not_there_is_one_line(folder, cluster, monkeypatch):
    boats = read_fleet(folder / "fleet.toml")
    with pytest.raises(BadInput, match="no recordings there"):
        run_fleet([str(folder / "logs" / "*.ulg")], boats, folder / "out", COMPARE)
    monkeypatch.setattr(running, "CONNECT_S", 0.5)
    with pytest.raises(BadInput, match="nowhere: there is no such file or folder"):
        run_fleet([str(folder / "nowhere")], boats, folder / "out", COMPARE)
    with pytest.raises(ShadowError, match="no Dask scheduler answers there"):
        run_fleet([str(folder / "logs")], boats, folder / "out", COMPARE,
                  scheduler="tcp://127.0.0.1:1")  # fmt: skip


def test_a_full_disk_is_one_line_and_leaves_the_table_of_before(folder, cluster, monkeypatch):
    go(folder, cluster)
    before = (folder / "out" / "recordings.parquet").read_bytes()
    (folder / "boat.toml").write_text((folder / "boat.toml").read_text() + "\n")
    results = folder / "out" / "results.jsonl"
    real = Path.open

    def full(self: Path, *mode, **more):
        if self == results and mode and "a" in mode[0]:
            raise OSError(28, "No space left on device")
        return real(self, *mode, **more)

    monkeypatch.setattr(Path, "open", full)
    with pytest.raises(ShadowError, match="No space left"):
        go(folder, cluster)
    table = pq.read_table(folder / "out" / "recordings.parquet")
    assert len(table) >= 1  # what was known, whole
    assert before


@pytest.mark.alone
def test_a_killed_worker_costs_nothing_and_a_lost_scheduler_keeps_what_was_done(folder):
    with local_cluster(1) as cluster:
        killed: list[int] = []

        def kill(now: Progress) -> None:
            if now.worked == 1 and not killed:
                (nanny,) = cluster.workers.values()
                killed.append(nanny.pid)
                nanny.process.process.kill()

        go(folder, cluster, progress=kill)
        assert killed
        assert states(folder)["monday"] == states(folder)["tuesday"] == "done"

        def gone(now: Progress) -> None:
            if now.worked == 1:
                cluster.close(timeout=10)

        (folder / "boat.toml").write_text((folder / "boat.toml").read_text() + "\n")
        with pytest.raises(ShadowError, match="scheduler is gone: 2 recordings left"):
            go(folder, cluster, progress=gone)
    with local_cluster(1) as cluster:
        assert go(folder, cluster).known == 1


@pytest.mark.slow
def test_a_diagnosis_is_a_row_with_its_effects_and_their_numbers():
    """A shipped recording whose compass is turned by eight degrees."""
    boat = fleet_of_one("demo_boat")[0]
    task = Task(str(RECORDINGS / "voyage_1.tlog"), boat, AnalysisSettings(("diagnose",)))
    found = analyse(task)
    assert (found.row["state"], found.row["verdict"]) == ("done", "explained")
    assert found.row["effects"] == ["heading_offset"]
    assert found.row["heldout_nrmse_after"] < 0.5 * found.row["heldout_nrmse_before"]
    (angle,) = (e for e in found.estimates if e["effect"] == "heading_offset")
    assert (angle["kind"], angle["origin"], angle["unit"]) == ("effect", "diagnose", "rad")
    assert angle["low"] < 0.14 < angle["high"]  # recordings/answers.json
