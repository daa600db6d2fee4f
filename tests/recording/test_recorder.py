"""Recordings when the disk, the run or the process that writes stops."""

import errno
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest
from hanging import PATIENCE_S, SOON_S, eventually
from planted_steps import a_step, bench, reading, recorder, sizes
from processes import has_ended

from zeromethod import Event, InputError, Recording
from zeromethod.child_process import NICENESS
from zeromethod.recording import writing
from zeromethod.recording.status import Condition, RecorderStatus

RUN = """
import sys, time
from planted_steps import bench, read, recorder, a_step
from pathlib import Path
bench()
recorder = recorder(Path(sys.argv[1]))
print(recorder.writer_id, flush=True)
for number in range(1, 100_000):
    step = a_step(number)
    recorder.add_step(step)
    recorder.add_reading(read(step))
    print(number, flush=True)
    if number == int(sys.argv[2]):
        {then}
    time.sleep(0.005)
"""


@contextmanager
def running(path: Path, steps: int, then: str = "time.sleep(1000)") -> Iterator[subprocess.Popen[str]]:
    """A process that records so many steps, and then does something; it prints what it handed over."""
    environment = os.environ | {"PYTHONPATH": str(Path(__file__).parent.parent)}
    command = [sys.executable, "-c", RUN.format(then=then), str(path), str(steps)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=environment) as process:
        try:
            yield process
        finally:
            process.kill()


def test_killed_in_the_middle_all_but_the_newest_is_there(path):
    with running(path, 10**9) as process:
        writer = int(process.stdout.readline())
        # what is flushed while it goes on, five times a second on a quiet machine, is what a kill leaves
        assert writing.FLUSH_S <= 0.5
        while int(process.stdout.readline()) < 50:
            pass
        with Recording(path) as found:

            def many_there() -> int:
                found.refresh()
                return len(found.steps) > 50

            eventually(many_there)
            flushed = int(found.steps["number"][-1])
        # between two flushes: a kill within one leaves some of its arrays
        time.sleep(0.5 * writing.FLUSH_S)
        os.kill(writer, signal.SIGKILL)
        os.kill(process.pid, signal.SIGKILL)
        process.wait()
    with Recording(path) as found:
        assert not found.complete
        newest = int(found.steps["number"][-1])
        assert newest >= flushed
        for number in range(1, flushed + 1):
            image, warp = found.image(number), found.measured(number)
            assert image is not None
            assert warp is not None
        step = a_step(flushed)
        np.testing.assert_array_equal(image, step.image)
        assert warp.q.tobytes() == step.measured.q.tobytes()
    with h5py.File(path, "r", swmr=True) as file:
        assert len(file["frames/image"]) >= flushed


def test_what_was_handed_over_is_soon_there_though_nothing_follows(path):
    with running(path, 20) as process:
        writer = int(process.stdout.readline())
        for _ in range(20):
            process.stdout.readline()
        with Recording(path) as found:

            def all_there() -> bool:
                found.refresh()
                return len(found.steps) == len(found.steps_with("surface")) == 20

            eventually(all_there)
        for number in (writer, process.pid):
            os.kill(number, signal.SIGKILL)
    with Recording(path) as found:
        np.testing.assert_array_equal(found.image(20), a_step(20).image)


@pytest.mark.parametrize("then", ["raise SystemExit", "import os; os.kill(os.getpid(), 9)"])
def test_without_an_end_the_recording_still_gets_one(path, then):
    with running(path, 10, f"time.sleep(0.5); {then}") as process:
        writer = int(process.stdout.readline())
        process.wait(PATIENCE_S)
        eventually(lambda: has_ended(writer))
    # closed in order: the plain way of opening does
    with h5py.File(path, "r") as file:
        assert len(file["steps/table"]) == 10
        assert not file["complete"][()]


READER = """
import sys, h5py, time
with h5py.File(sys.argv[1], "r", swmr=True) as file:
    frames, steps = file["frames/image"], file["steps/table"]
    while len(steps) < int(sys.argv[2]):
        time.sleep(0.01)
        steps.refresh()
    frames.refresh()
    print(int(frames[-1].sum()), int(steps[-1]["number"]), bool(file["complete"][()]))
"""


def test_another_process_reads_along_with_h5py_alone(path):
    with recorder(path) as recording:
        for number in range(1, 6):
            recording.add_step(a_step(number))
        command = [sys.executable, "-c", READER, str(path), "5"]
        printed = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE_S, check=True)
        for number in range(6, 9):
            recording.add_step(a_step(number))
    image = a_step(5).image
    assert printed.stdout.split() == [str(int(image.sum())), "5", "False"]
    with Recording(path) as found:
        assert found.complete
        assert len(found.steps) == 8


def test_a_disk_that_takes_nothing_holds_nobody_up(path):
    room = 10
    # but for the numbers that go with the arrays
    most = room * (sizes().step + 100)
    with recorder(path, waiting_bytes=most, live=True) as recording:
        # as a write that does not return
        os.kill(recording.writer_id, signal.SIGSTOP)
        steps = [a_step(number) for number in range(1, 61)]
        began_s = time.thread_time()
        for step in steps:
            recording.add_step(step)
        spent_s = time.thread_time() - began_s
        assert recording.waiting_bytes <= most
        unkept = recording.unkept
        # some were on their way already
        assert 60 - 2 * room < unkept <= 60 - room
        assert recording.status == RecorderStatus(Condition.DISK_TOO_SLOW, unkept)
        # 0.03 ms each on a quiet machine
        assert spent_s / 60 < 0.002
        os.kill(recording.writer_id, signal.SIGCONT)
    with Recording(path) as found:
        assert found.complete
        assert len(found.steps) == len(found.presentation_log) == 60
        late = {int(row["step"]) for row in found.drops}
        assert len(found.drops) == unkept
        assert late | set(found.steps_with("frames").tolist()) == set(range(1, 61))
        assert {found.text(row["reason"]) for row in found.drops} == {"the disk is too slow"}
        # pictures stand by their own rows
        for index in range(60):
            q, shown = found.picture_q(index), a_step(index + 1).presented[0].q
            assert (q is None) == (index + 1 in late)
            if q is not None:
                np.testing.assert_array_equal(q, shown)


def test_in_simulated_time_the_disk_is_waited_for(path):
    with recorder(path, waiting_bytes=2 * (sizes().step + 100)) as recording:
        for number in range(1, 41):
            recording.add_step(a_step(number))
        assert recording.status == RecorderStatus()
    with Recording(path) as found:
        assert len(found.steps_with("frames")) == 40


def frames_kept(found: Recording) -> int:
    """Frames of the file whose step is there, too: a kill may fall between the two."""
    return int(np.isin(found.steps_with("frames"), found.steps["number"]).sum())


def test_when_what_writes_is_killed_the_run_goes_on_and_every_frame_is_accounted_for(path):
    handed = 0
    with recorder(path) as recording:

        def hand_over() -> bool:
            nonlocal handed
            handed += 1
            recording.add_step(a_step(handed))
            return recording.status != RecorderStatus()

        def some_kept() -> bool:
            hand_over()
            with Recording(path) as found:
                return frames_kept(found) > 0

        eventually(some_kept)
        # all that was handed over is flushed: a kill within a flush leaves some of its arrays
        time.sleep(5 * writing.FLUSH_S)
        os.kill(recording.writer_id, signal.SIGKILL)
        eventually(hand_over)
        assert recording.status.condition is Condition.STOPPED
        assert recording.status.reason == "the process that writes has ended"
        hand_over()
    with Recording(path) as found:
        assert not found.complete
        kept = frames_kept(found)
    assert kept > 0
    assert recording.status.unkept == handed - kept


@pytest.mark.skipif(sys.platform != "linux", reason="niceness is asked of Linux")
def test_what_writes_hears_no_ctrl_c_and_leaves_the_cores_to_the_loop(path):
    with recorder(path) as recording:
        writer = recording.writer_id
        assert os.getpgid(writer) != os.getpgid(0)
        # within one session, or niceness would not count against the loop where the system groups by sessions
        assert os.getsid(writer) == os.getsid(0)
        assert os.getpriority(os.PRIO_PROCESS, writer) == max(NICENESS, os.getpriority(os.PRIO_PROCESS, 0))


def test_a_start_that_fails_leaves_nothing_behind(path, monkeypatch):

    def no_memory(size: int) -> None:
        raise OSError(errno.EFBIG, "File too large")

    with monkeypatch.context() as short:
        short.setattr("zeromethod.recording.line.Ring", no_memory)
        with pytest.raises(InputError, match="no 64 MB of shared memory to record by: the limit of a file's"):
            recorder(path)
    assert not path.exists()
    with recorder(path) as recording:
        recording.add_step(a_step(1))
    with Recording(path) as found:
        assert len(found.steps) == 1


def test_a_disk_that_takes_nothing_does_not_keep_the_run_from_ending(path, monkeypatch):
    monkeypatch.setattr("zeromethod.recording.recorder.CLOSING_S", 0.3)
    recording = recorder(path)
    os.kill(recording.writer_id, signal.SIGSTOP)
    for number in range(1, 31):
        recording.add_step(a_step(number))
    began_s = time.monotonic()
    recording.close()
    assert time.monotonic() - began_s < SOON_S
    assert recording.status.condition is Condition.STOPPED
    assert recording.status.reason.startswith("the disk took nothing for 0.3 s")
    os.kill(recording.writer_id, signal.SIGCONT)
    eventually(lambda: has_ended(recording.writer_id))
    # what was handed over is written, should the disk come back
    with Recording(path) as found:
        assert len(found.steps) == 30


def test_frames_that_the_camera_lost_are_records(path):
    wrong = np.zeros((4, 4), np.uint8)
    with recorder(path) as recording:
        recording.add_step(a_step(1))
        recording.add_step(a_step(2, dropped=3, events=(Event.FRAMES_DROPPED,)))
        recording.add_step(
            a_step(3, image=wrong, events=(Event.FRAME_WRONG,), reason="the frame is (4, 4) uint8")
        )
    with Recording(path) as found:
        rows = [(row["step"], row["count"], row["lost_by"], found.text(row["reason"])) for row in found.drops]
        assert rows == [
            (2, 3, b"camera", "lost before frame 1002"),
            (3, 1, b"camera", "the frame is (4, 4) uint8"),
        ]
        assert list(found.steps_with("frames")) == [1, 2]
        assert found.events_of(found.row(2)) == (Event.FRAMES_DROPPED,)


def test_words_of_any_length_and_script_are_kept_as_far_as_they_fit(path):
    with recorder(path, keep=()) as recording:
        recording.add_step(a_step(1, reason="µ" * 200, notes=("first", "zweite Ä")))
    with Recording(path) as found:
        # a field of 160 bytes, characters of two
        assert found.text(found.steps[0]["reason"]) == "µ" * 80
        assert [found.text(row["text"]) for row in found.notes] == ["first", "zweite Ä"]


def test_a_zero_is_kept_once_with_its_first_step(path):
    zero = np.full_like(bench()[1].q, 0.125)
    with recorder(path) as recording:
        for number in range(1, 6):
            recording.add_step(a_step(number, zero=zero if number > 2 else None))
    with Recording(path) as found:
        assert list(found.steps_with("zeros")) == [3]
        assert found.zero(2) is None
        for number in (3, 5):
            np.testing.assert_array_equal(found.zero(number), zero)


def test_readings_are_kept_with_their_steps(path):
    with recorder(path) as recording:
        for number in range(1, 4):
            recording.add_step(a_step(number))
        surface, peak = reading(2)
        recording.add_reading(replace(a_step(2), surface=surface, peak=peak, read_ms=3.5))
    with Recording(path) as found:
        assert list(found.steps_with("surface")) == [2]
        back = found.surface(2)
        np.testing.assert_array_equal(back.slope, surface.slope.astype(np.float32))
        assert (back.anchor.sigma_mm, back.anchor.far_field_mm) == (1e-4, 2e-4)
        assert found.peaks[0]["read_ms"] == 3.5
