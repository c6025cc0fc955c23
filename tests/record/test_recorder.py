"""The recorder on disks that are full, slow, removed or broken: what it cannot write is counted, and it goes on."""

from __future__ import annotations

import errno
import random
import shutil
import threading
import time
from dataclasses import replace
from pathlib import Path

import pytest

from mkdaemon.record.reader import Recording
from mkdaemon.record.recorder import FLUSH, RETRY, RecorderThread
from mkdaemon.telemetry.record import RecorderState
from tests.record.support import ROOMY, Bench, sample


def numbers(folder: Path) -> list[int]:
    """Sequence numbers of all entries in all files of a folder."""
    return [entry.sequence for path in sorted(folder.glob("*.mcap")) for entry in Recording(path).entries()]


@pytest.mark.parametrize("limits", [replace(ROOMY, file_bytes=20_000), replace(ROOMY, file_time=1.0)])
def test_a_file_is_ended_at_its_size_and_at_its_age(tmp_path, limits):
    bench = Bench(tmp_path, limits=limits)
    for number in range(1, 401):
        bench.queue.put(
            sample(number, size=500)._replace(payload=bytes([(number * 31 + i * i) % 256 for i in range(500)]))
        )
        bench.run(0.02)
    bench.recorder.close(bench.now)

    files = [Recording(path) for path in sorted(tmp_path.glob("*.mcap"))]
    assert len(files) > 2
    assert [file.read_session().part for file in files] == list(range(len(files)))
    assert numbers(tmp_path) == list(range(1, 401))
    assert all(file.report.is_whole for file in files if list(file.entries()))


def test_the_oldest_recordings_are_deleted_where_that_is_allowed(tmp_path):
    limits = replace(ROOMY, file_time=1.0, total_bytes=30_000, may_delete=True)
    (tmp_path / "mk1-notes.txt").write_text("mine")
    (tmp_path / "mk1-x-20200101T000000Z-000.mcap").write_bytes(b"x" * 10)
    (tmp_path / "mk1-20200101T000000Z-000.mcap").write_bytes(b"x" * 29_000)
    bench = Bench(tmp_path, limits=limits)
    for number in range(1, 801):
        bench.put(number, number)
        bench.run(0.02)
        assert sum(path.stat().st_size for path in tmp_path.glob("mk1-2*.mcap")) < 40_000

    assert not (tmp_path / "mk1-20200101T000000Z-000.mcap").exists()
    assert (tmp_path / "mk1-notes.txt").exists()
    assert (tmp_path / "mk1-x-20200101T000000Z-000.mcap").exists()  # another vehicle's
    assert numbers(tmp_path)[-1] > 750
    assert bench.queue.lost == 0


@pytest.mark.parametrize(("change", "words"), [({"free": 50}, "free on the disk"), ({}, "may take")])
def test_without_room_it_stops_readable_says_why_and_goes_on_when_there_is_room(tmp_path, change, words):
    limits = replace(ROOMY, total_bytes=20_000 if not change else 10**9, free_bytes=100)
    bench = Bench(tmp_path, limits=limits)
    bench.record(1, 50)
    bench.free = change.get("free", bench.free)
    if not change:
        (tmp_path / "mk1-20200101T000000Z-000.mcap").write_bytes(b"x" * 30_000)

    bench.run(2.0)

    (path,) = tmp_path.glob("mk1-2026*.mcap")
    recording = Recording(path)
    assert len(list(recording.entries())) == 50
    assert recording.report.is_whole
    assert bench.recorder.report.state is RecorderState.FULL
    assert words in bench.recorder.report.reason

    bench.free = 10**12
    (tmp_path / "mk1-20200101T000000Z-000.mcap").unlink(missing_ok=True)
    bench.put(51, 60)
    bench.run(RETRY + FLUSH + 0.2)
    assert bench.recorder.report.state is RecorderState.RECORDING
    assert numbers(tmp_path) == list(range(1, 61))


def test_a_disk_that_is_full_costs_nothing_before_the_queue_is_full_and_the_file_stays_readable(tmp_path):
    bench = Bench(tmp_path, capacity=100_000)
    bench.record(1, 50)
    bench.disk.error = errno.ENOSPC
    bench.record(51, 70)
    assert bench.recorder.report.state is RecorderState.FAULT
    assert "No space left" in bench.recorder.report.reason
    assert bench.queue.lost == 0
    assert numbers(tmp_path) == list(range(1, 51))

    bench.put(71, 200)  # as many as the queue holds wait for the disk
    bench.run(RETRY + 1)
    waiting, lost = len(bench.queue), bench.queue.lost
    assert waiting > 100
    assert len(list(tmp_path.iterdir())) == 1
    bench.disk.error = 0
    bench.run(RETRY + FLUSH + 0.3)
    bench.recorder.close(bench.now)

    found = numbers(tmp_path)
    assert found == list(range(1, 51 + waiting))
    assert bench.queue.lost == lost
    assert 200 - len(found) == lost


def test_a_disk_that_others_fill_costs_older_recordings_and_never_the_present_one(tmp_path):
    bench = Bench(tmp_path, limits=replace(ROOMY, file_time=1.0, free_bytes=100, may_delete=True))
    (tmp_path / "mk1-20200101T000000Z-000.mcap").write_bytes(b"old")
    for number in range(1, 151):
        bench.put(number, number)
        bench.run(0.02)
    assert len(list(tmp_path.glob("mk1-2026*.mcap"))) > 2
    bench.free = 50
    bench.run(RETRY)

    assert bench.recorder.report.state is RecorderState.FULL
    assert not (tmp_path / "mk1-20200101T000000Z-000.mcap").exists()
    assert numbers(tmp_path) == list(range(1, 151))


def test_entries_that_are_written_once_are_not_written_again_after_a_fault(tmp_path):
    bench = Bench(tmp_path, capacity=10**8)
    for number in range(1, 41):  # a chunk is full after each 11 of them
        bench.queue.put(sample(number)._replace(payload=random.Random(number).randbytes(100_000)))
    bench.run(0.01)
    bench.disk.error = errno.EIO
    bench.run(FLUSH)
    bench.disk.error = 0
    bench.run(RETRY + FLUSH + 0.1)
    assert numbers(tmp_path) == list(range(1, 41))
    assert bench.queue.lost == 0


def test_a_removed_folder_is_noticed_and_made_again(tmp_path):
    folder = tmp_path / "recordings"
    bench = Bench(folder)
    bench.record(1, 50)
    shutil.rmtree(folder)
    bench.put(51, 60)
    bench.run(1.2)
    assert bench.recorder.report.state is RecorderState.FAULT
    assert "removed, and 50 entries with it" in bench.recorder.report.reason
    bench.put(61, 70)
    bench.run(RETRY + FLUSH + 0.2)

    assert bench.recorder.report.state is RecorderState.RECORDING
    bench.recorder.close(bench.now)
    assert numbers(folder) == list(range(51, 71))
    assert (bench.queue.lost, bench.recorder.report.entries) == (50, 20)


def test_a_file_is_brought_to_the_disk_as_often_as_configured(tmp_path):
    bench = Bench(tmp_path, sync_period=5.0)
    for number in range(1, 201):
        bench.put(number, number)
        bench.run(0.1)
    assert bench.disk.synced == pytest.approx(20 / 5, abs=1)


def test_a_disk_that_hangs_costs_entries_and_nothing_else(tmp_path, monkeypatch):
    bench = Bench(tmp_path, capacity=50_000)
    hanging, go_on = threading.Event(), threading.Event()

    def hang():
        hanging.set()
        go_on.wait(10.0)

    bench.put(1, 10)
    bench.disk.written = hang
    thread = RecorderThread(bench.recorder)
    thread.start()
    assert hanging.wait(10.0)
    began = time.monotonic()
    bench.put(11, 1000)
    assert time.monotonic() - began < 1.0
    assert bench.queue.size <= 50_000
    lost = bench.queue.lost
    assert lost > 800
    assert thread.report.state is RecorderState.RECORDING
    monkeypatch.setattr("mkdaemon.record.recorder.STALLED", 0.0)
    assert thread.report.state is RecorderState.FAULT
    assert "has not answered" in thread.report.reason
    assert not thread.stop(0.01)
    go_on.set()
    assert thread.stop(10.0)

    found = numbers(tmp_path)
    assert found == list(range(1, 1000 - lost + 1))


def test_deferred_entries_give_way_to_others(tmp_path):
    bench = Bench(tmp_path, capacity=40_000)
    bench.queue.defer(lambda: sample(1), 5_000)
    bench.queue.defer(lambda: sample(2), 5_000)
    bench.queue.defer(lambda: None, 100)
    bench.put(3, 5)
    assert bench.queue.lost == 1
    bench.run(FLUSH + 0.1)
    assert numbers(tmp_path) == [1, 3, 4, 5]
    assert bench.recorder.report.state is RecorderState.RECORDING


def test_who_is_restarted_in_the_same_second_begins_another_recording(tmp_path):
    for _ in range(3):
        bench = Bench(tmp_path)
        bench.put(1, 5)
        bench.recorder.close(bench.now)
    names = [Recording(path).read_session().name for path in sorted(tmp_path.glob("*.mcap"))]
    assert names == [f"mk1-20261122T08000{second}Z" for second in range(3)]
