"""Dirt that was there at the first rest is rest; a press as small that comes later is not, and is no zero."""

import numpy as np
import pytest
from node_bench import SIGMA_PX, dent, rest_warp

from zeromethod.loop.events import Event
from zeromethod.loop.zero import FRAMES, LIFT, Zero
from zeromethod.warp.warp import Warp

REST = rest_warp(512)
SIGMA = 0.84 * SIGMA_PX
ROW, COL = np.indices(REST.grid.shape)
DIRT = np.zeros_like(REST.q)
DIRT[20:24, 30:34] = 0.3, -0.2
FEW = 0.25 * ((abs(ROW - 22) < 2) & (abs(COL - 36) < 2))[..., None] * np.array([1.0, -1.0])
"""A press smaller than dirt, right next to it: three nodes on a side."""
SHALLOW = dent(REST, 0.06, 60.0, 10.0)
"""A press of 0.06 LCD px, 0.04 rms in its steepest block: below what drift may be, with noise."""


def seen(away, seed):
    q = REST.q + away + SIGMA * np.random.default_rng(seed).standard_normal(REST.q.shape)
    return Warp(q, np.full_like(q, SIGMA), np.zeros(REST.grid.shape, np.uint16), seed)


def rested(away, seed=100, frames=20):
    """A zero that has seen the mirror at rest, with what was off there."""
    zero = Zero(REST)
    for k in range(frames):
        warp = seen(away, seed + k)
        assert zero.at_rest(REST.q + away, warp)
        zero.take(warp, 0.01, resting=True)
    return zero


def rests(zero, away, seed=1):
    return zero.at_rest(REST.q + away, seen(away, seed))


def asked(zero, away, seed=200):
    """The notice that a zero ends in."""
    zero.request()
    (notice,) = filter(None, (zero.take(seen(away, seed + k), 0.01) for k in range(FRAMES)))
    return notice


@pytest.mark.parametrize("press", [FEW, SHALLOW, -SHALLOW])
def test_a_small_press_is_no_rest_once_the_mirror_has_been_at_rest(press):
    # in one frame it cannot be distinguished from dirt and drift
    assert rests(Zero(REST), DIRT + press)
    zero = rested(DIRT)
    assert all(rests(zero, DIRT, seed) for seed in range(50))
    assert not rests(zero, DIRT + press)
    assert rests(zero, DIRT)


@pytest.mark.parametrize(("press", "words"), [(FEW, "a dent of 0.09"), (0.5 * FEW, LIFT), (SHALLOW, LIFT)])
def test_a_zero_is_refused_while_what_was_not_there_at_rest_presses(press, words):
    zero = rested(DIRT)
    notice = asked(zero, DIRT + press)
    assert notice.event is Event.ZERO_REFUSED
    assert "something presses" in notice.words
    assert words in notice.words
    assert zero.q is None


def test_dirt_that_was_there_at_rest_does_not_keep_a_zero_from_being_taken():
    drift = 0.04 * np.stack([COL / COL.max(), 1 - ROW / ROW.max()], axis=-1)
    zero = rested(DIRT)
    assert rests(zero, DIRT + drift)
    assert asked(zero, DIRT + drift).event is Event.ZERO_TAKEN
    # to the noise of eight frames
    assert np.std((zero.q - DIRT - drift)[REST.visible]) == pytest.approx(SIGMA / FRAMES**0.5, rel=0.05)
    # what is said to be rest now is
    assert rests(zero, DIRT + drift)
    assert not rests(zero, DIRT + drift + FEW)


def test_what_lifts_after_the_first_rest_leaves_a_mirror_at_rest():
    zero = rested(FEW)
    assert rests(zero, 0.0 * FEW)
    assert rests(zero, FEW)


def test_dirt_may_move_its_nodes_by_a_fifth_more_or_less():
    zero = rested(DIRT)
    assert rests(zero, 1.2 * DIRT)
    assert rests(zero, 0.8 * DIRT)
    assert not rests(zero, 2 * DIRT)
