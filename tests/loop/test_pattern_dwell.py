"""How long pictures are held, by how well the loop locks."""

import math

from zeromethod.loop.pattern_dwell import LONGEST_FRAMES, LOWER_FRAMES, RAISE_FRAMES, Hold

FRAME_NS = 1e9 / 60


def _note(hold: Hold, frames: int, unusable: bool = False, residual: float = 0.01) -> None:
    for _ in range(frames):
        hold.note(unusable, residual)


def test_every_picture_is_presented_while_the_loop_locks() -> None:
    hold = Hold(FRAME_NS)
    hold.presented(0)
    _note(hold, 200)
    assert hold.period_frames == 1
    assert hold.may_present(1)


def test_single_mixed_frames_change_nothing() -> None:
    hold = Hold(FRAME_NS)
    for n in range(300):
        hold.note(n % 4 == 0, 0.01)
    assert hold.period_frames == 1


def test_frames_that_stay_mixed_or_far_from_null_are_held_longer_up_to_three() -> None:
    for unusable, residual in ((True, math.nan), (False, 0.5)):
        hold = Hold(FRAME_NS)
        _note(hold, RAISE_FRAMES, unusable, residual)
        assert hold.period_frames == 2
        _note(hold, 10 * RAISE_FRAMES, unusable, residual)
        assert hold.period_frames == LONGEST_FRAMES


def test_motion_does_not_lengthen_what_strips_tell_apart() -> None:
    hold = Hold(FRAME_NS, timed=True)
    _note(hold, 10 * RAISE_FRAMES, residual=0.5)
    assert hold.period_frames == 1
    _note(hold, RAISE_FRAMES, unusable=True)
    assert hold.period_frames == 2


def test_picture_is_held_for_its_period_and_no_longer() -> None:
    hold = Hold(FRAME_NS)
    _note(hold, RAISE_FRAMES, unusable=True)
    hold.presented(1000)
    assert not hold.may_present(round(1000 + 1.0 * FRAME_NS))
    assert hold.may_present(round(1000 + 1.6 * FRAME_NS))


def test_period_shortens_again_after_quiet_frames() -> None:
    hold = Hold(FRAME_NS)
    _note(hold, RAISE_FRAMES, unusable=True)
    _note(hold, LOWER_FRAMES)
    assert hold.period_frames == 1


def test_shortening_that_fails_is_tried_less_and_less_often() -> None:
    hold = Hold(FRAME_NS)
    _note(hold, RAISE_FRAMES, unusable=True)
    quiet = []
    for _ in range(4):
        frames = 0
        while hold.period_frames == 2:
            hold.note(False, 0.01)
            frames += 1
        quiet.append(frames)
        # at one frame per picture everything is mixed
        while hold.period_frames == 1:
            hold.note(True, math.nan)
    assert quiet == [LOWER_FRAMES, 2 * LOWER_FRAMES, 4 * LOWER_FRAMES, 8 * LOWER_FRAMES]
