"""What becomes of a recording when its disk is full, and when there is room again."""

import errno
import resource
import time
from types import SimpleNamespace

import numpy as np
import pytest
from hanging import eventually
from planted_steps import FRAME_NS, a_step, read, recorder, sizes

from zeromethod.recording.growing import TABLES_BYTES, DiskFull, GrowingFile
from zeromethod.recording.message import Item, Message, Topic, Write
from zeromethod.recording.recorder import Recorder
from zeromethod.recording.recording import Recording
from zeromethod.recording.status import Condition
from zeromethod.recording.writing import Writing


def fill_disk(recording: Recorder, size: int) -> None:
    """Let what writes make its file no larger than that: to it, the disk is full there."""
    resource.prlimit(recording.writer_id, resource.RLIMIT_FSIZE, (size, size))


def test_a_full_disk_ends_the_arrays_and_not_the_tables(path):
    room = 8
    with recorder(path) as recording:
        fill_disk(recording, TABLES_BYTES + room * sizes().step)
        for number in range(1, 41):
            recording.add_step(a_step(number))
        eventually(lambda: recording.waiting_bytes == 0 and recording.unkept > 0)
        said = str(recording.status)
    first = 1e-9 * FRAME_NS * (40 - recording.unkept)
    assert said.startswith(f"disk full: recording stopped at {first:.1f} s (the limit of a file's size, ")
    with Recording(path) as found:
        assert found.complete
        # when it was noticed, and with the count at the end
        noted = [found.text(row["text"]) for row in found.notes]
        assert noted[0].startswith(f"recording: disk full: recording stopped at {first:.1f} s")
        assert noted[-1] == f"recording: {recording.status}"
        kept = found.steps_with("frames")
        assert 0 < len(kept) <= room
        assert len(found.steps) == 40
        lost = set(range(1, 41)) - set(kept.tolist())
        assert {int(row["step"]) for row in found.drops} == lost
        assert {(row["lost_by"], row["reason"]) for row in found.drops} == {
            (b"recorder", b"the disk is full")
        }
        for number in kept:
            np.testing.assert_array_equal(found.image(number), a_step(int(number)).image)
    assert path.stat().st_size < TABLES_BYTES


@pytest.mark.parametrize("left", [0.3, 0.6, 0.9])
def test_what_is_small_enough_for_a_full_disk_does_not_make_it_one_that_was_full(path, left):
    with recorder(path) as recording:
        # the arrays of a reading are smaller than those of a step
        fill_disk(recording, TABLES_BYTES + int((4 + left) * sizes().step))
        for number in range(1, 21):
            recording.add_step(a_step(number))
            recording.add_reading(read(a_step(number)))
            eventually(lambda: not recording._queue)
            time.sleep(0.002)
    with Recording(path) as found:
        noted = [found.text(row["text"]) for row in found.notes]
    assert noted
    assert all(words.startswith("recording: disk full: recording stopped at ") for words in noted)


class Disk:
    """What takes items into a file with so much room for arrays."""

    def __init__(self, room: int) -> None:
        self.room = room

    def claim(self, wanted: int, arrays: bool) -> None:
        if arrays and wanted > self.room:
            raise DiskFull("no room")
        self.room -= wanted if arrays else 0

    def append(self, index: int, item: memoryview) -> None:
        pass


def test_room_is_reported_again_once_as_much_fits_as_did_not(monkeypatch):
    disk = Disk(room=15)
    writing = Writing(disk, memoryview(bytes(100)), -1)  # type: ignore[arg-type]
    reported: list[Topic] = []
    monkeypatch.setattr(writing, "report", lambda topic, *_: reported.append(topic))

    def take(size: int) -> list[Topic]:
        reported.clear()
        writing.take(Message(0, [Item(0, Write.WITH_ROOM, 0, size)]))
        return [topic for topic in reported if topic is not Topic.WRITTEN]

    assert take(20) == [Topic.FULL]
    # smaller ones find the room that is left
    assert [take(7), take(7), take(7)] == [[], [], [Topic.FULL]]
    disk.room = 100
    assert [take(5), take(5), take(20)] == [[], [Topic.ROOM], []]


def test_where_even_tables_have_no_room_the_file_stays_readable(path):
    bare = {"image": None, "residual": None, "measured": None, "shown": None, "presented": ()}
    with recorder(path, keep=()) as recording:
        fill_disk(recording, 3 << 20)
        number = 0
        while recording.status.condition is Condition.ALL_KEPT and number < 10_000:
            number += 1
            recording.add_step(a_step(number, notes=("x" * 240,) * 40, **bare))
            eventually(lambda: not recording._queue)
            time.sleep(0.002)
        assert recording.status.condition is Condition.STOPPED
        assert recording.status.reason.startswith("the disk is full (")
        recording.add_step(a_step(number + 1))
        unkept = recording.unkept
    with Recording(path) as found:
        assert unkept == number + 1 - len(found.steps) > 0
        # all but what was on its way
        assert len(found.steps) > 0.5 * number


@pytest.mark.parametrize(
    ("disk_mb", "least"),
    [(6, "less than 3 MB free"), (20, "less than 3 MB free"), (200, "less than 18 MB free")],
)
def test_the_room_left_for_tables_goes_with_that_of_the_disk(disk_mb, least, path, monkeypatch):
    with recorder(path) as recording:
        parts = list(recording._parts)
    size = path.stat().st_size
    used = 0

    def claim(_: int, start: int, length: int) -> None:
        nonlocal used
        if start + length - size > disk_mb << 20:
            raise OSError(errno.ENOSPC, "No space left on device")
        used = start + length - size

    def free(_: int) -> SimpleNamespace:
        return SimpleNamespace(f_bavail=(disk_mb << 20) - used, f_frsize=1)

    monkeypatch.setattr("zeromethod.recording.growing.os.posix_fallocate", claim)
    monkeypatch.setattr("zeromethod.recording.growing.os.fstatvfs", free)
    file = GrowingFile(path, parts)
    taken = 0

    def fill() -> None:
        nonlocal taken
        while True:
            file.claim(sizes().step, arrays=True)
            taken += sizes().step

    with pytest.raises(DiskFull, match=least):
        fill()
    # an eighth, at most 16 MB, at least 2 MB
    left = min(16 << 20, max(2 << 20, (disk_mb << 20) // 8))
    assert 0 <= (disk_mb << 20) - left - taken < sizes().step
    for _ in range(10):
        file.claim(1000, arrays=False)
    file.close(complete=True)
