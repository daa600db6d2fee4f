"""How long pictures stay, by how well the loop locks."""

import math

from zeromethod.loop.pattern_dwell import LONGEST_FRAMES, LOWER_FRAMES, RAISE_FRAMES, PatternDwell

FRAME_NS = 1e9 / 60


def _note(dwell: PatternDwell, frames: int, unusable: bool = False, residual: float = 0.01) -> None:
    for _ in range(frames):
        dwell.note(unusable, residual)


def test_every_picture_is_presented_while_the_loop_locks():
    dwell = PatternDwell(FRAME_NS)
    dwell.presented(0)
    _note(dwell, 200)
    assert dwell.period_frames == 1
    assert dwell.may_present(1)


def test_single_mixed_frames_change_nothing():
    dwell = PatternDwell(FRAME_NS)
    for n in range(300):
        dwell.note(n % 4 == 0, 0.01)
    assert dwell.period_frames == 1


def test_pictures_stay_longer_where_frames_remain_mixed_or_far_from_null():
    for unusable, residual in ((True, math.nan), (False, 0.5)):
        dwell = PatternDwell(FRAME_NS)
        _note(dwell, RAISE_FRAMES, unusable, residual)
        assert dwell.period_frames == 2
        _note(dwell, 10 * RAISE_FRAMES, unusable, residual)
        assert dwell.period_frames == LONGEST_FRAMES


def test_motion_does_not_lengthen_what_strips_distinguish():
    dwell = PatternDwell(FRAME_NS, timed=True)
    _note(dwell, 10 * RAISE_FRAMES, residual=0.5)
    assert dwell.period_frames == 1
    _note(dwell, RAISE_FRAMES, unusable=True)
    assert dwell.period_frames == 2


def test_a_picture_stays_for_its_period_and_no_longer():
    dwell = PatternDwell(FRAME_NS)
    _note(dwell, RAISE_FRAMES, unusable=True)
    dwell.presented(1000)
    assert not dwell.may_present(round(1000 + 1.0 * FRAME_NS))
    assert dwell.may_present(round(1000 + 1.6 * FRAME_NS))


def test_period_shortens_again_after_quiet_frames():
    dwell = PatternDwell(FRAME_NS)
    _note(dwell, RAISE_FRAMES, unusable=True)
    _note(dwell, LOWER_FRAMES)
    assert dwell.period_frames == 1


def test_shortening_that_fails_is_tried_less_and_less_often():
    dwell = PatternDwell(FRAME_NS)
    _note(dwell, RAISE_FRAMES, unusable=True)
    quiet = []
    for _ in range(4):
        frames = 0
        while dwell.period_frames == 2:
            dwell.note(False, 0.01)
            frames += 1
        quiet.append(frames)
        # at one frame per picture everything is mixed
        while dwell.period_frames == 1:
            dwell.note(True, math.nan)
    assert quiet == [LOWER_FRAMES, 2 * LOWER_FRAMES, 4 * LOWER_FRAMES, 8 * LOWER_FRAMES]
