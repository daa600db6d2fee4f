"""Parts of a recording, and the pace of a replay."""

import pytest

from zeromethod.errors import InputError
from zeromethod.session.replay import window
from zeromethod.session.replay.window import Pace, Window


def test_a_window_counts_from_the_first_frame(recording):
    whole, part = Window.of(recording), Window.of(recording, 0.2, 0.5)
    steps = recording.steps
    assert whole.from_start
    assert whole.start_ns == whole.from_ns == int(steps["time_ns"][0])
    assert whole.to_ns == int(steps["time_ns"][steps["frame_number"] >= 0][-1])
    assert not part.from_start
    assert part.from_ns - whole.start_ns == 200_000_000
    assert part.from_ns in part
    assert part.to_ns in part
    assert part.from_ns - 1 not in part


@pytest.mark.parametrize(
    ("from_s", "to_s", "word"),
    [
        (5.0, None, "lasts 0.7"),
        (0.5, 0.4, "nothing is there"),
        (-1.0, None, "from 0 on"),
        (None, float("nan"), "--to"),
    ],
)
def test_times_outside_the_recording_are_refused(recording, from_s, to_s, word):
    with pytest.raises(InputError, match=word):
        Window.of(recording, from_s, to_s)


def test_where_a_recording_ends_is_reported_as_everywhere(recording):
    steps = recording.steps
    # the step that ended it has no frame
    assert steps["frame_number"][-1] < 0
    last_s = 1e-9 * float(steps["time_ns"][steps["frame_number"] >= 0][-1] - steps["time_ns"][0])
    assert last_s < recording.seconds
    words = f"the last frame came at {last_s:.3f} s, the recording lasts {recording.seconds:.3f} s"
    with pytest.raises(InputError, match=words):
        Window.of(recording, 5.0)


def test_a_pace_holds_to_its_speed_and_no_pace_to_none(monkeypatch):
    slept: list[float] = []
    clock = iter([100.0, 100.01, 100.2])
    monkeypatch.setattr(window.time, "sleep", slept.append)
    monkeypatch.setattr(window.time, "monotonic", lambda: next(clock))
    Pace(None).wait_for(10**18)
    assert slept == []
    pace = Pace(10.0)
    for time_ns in (5_000_000_000, 5_400_000_000, 5_800_000_000):
        pace.wait_for(time_ns)
    # at ten times the speed 0.4 s are 0.04 s, of which 0.01 s are gone; and who is late does not wait
    assert slept == pytest.approx([0.0, 0.03, 0.0])
