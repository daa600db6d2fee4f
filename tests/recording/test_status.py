"""The sentence that the operator reads about a recording."""

import pytest

from zeromethod.recording.status import Condition, RecorderStatus


@pytest.mark.parametrize(
    ("status", "words"),
    [
        (RecorderStatus(), ""),
        (RecorderStatus(Condition.DISK_TOO_SLOW, 15), "disk too slow: 15 frames not kept"),
        (RecorderStatus(Condition.DISK_WAS_FULL, 1), "disk was full: 1 frame not kept"),
        (
            RecorderStatus(Condition.DISK_FULL, 40, "less than 21 MB free", 12.34),
            "disk full: recording stopped at 12.3 s (less than 21 MB free), 40 frames not kept",
        ),
        (RecorderStatus(Condition.STOPPED, 0, "no reason"), "recording stopped: no reason"),
    ],
)
def test_every_condition_has_its_sentence(status, words):
    assert str(status) == words
    assert status.note == f"recording: {words or 'all is kept again'}"
