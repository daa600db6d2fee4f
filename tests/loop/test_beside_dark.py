"""Nodes beside a dark place: how long they stay lost, and what they know less."""

from __future__ import annotations

import numpy as np

from zeromethod.loop.beside_dark import EDGE_RAD, FRAMES, STAYS_FRAMES, BesideDark
from zeromethod.warp.validity import Flag

PERIOD_PX = 16
DARK, BESIDE, AMBIGUOUS = (np.uint16(flag) for flag in (Flag.LIGHT_LOST, Flag.BESIDE_DARK, Flag.AMBIGUOUS))


def frame(memory: BesideDark, *failed: tuple[int, int, np.uint16]) -> np.ndarray:
    """Flags of one frame in which these nodes fail, with what the memory adds."""
    flags = np.zeros((12, 12), np.uint16)
    for row, col, flag in failed:
        flags[row, col] |= flag
    memory.flag(flags, np.full((12, 12, 2), 0.01))
    memory.learn(flags)
    return flags


def beside_the_dark() -> BesideDark:
    """Memory of a place that has been dark for long."""
    memory = BesideDark((12, 12), PERIOD_PX)
    for _ in range(STAYS_FRAMES):
        frame(memory, (5, 5, DARK))
    return memory


def test_a_node_that_fails_once_counts_as_soon_as_it_is_back() -> None:
    memory = beside_the_dark()
    frame(memory, (5, 5, DARK), (5, 6, DARK))
    assert frame(memory, (5, 5, DARK))[5, 6] == 0


def test_a_node_that_flickers_stays_lost_until_it_was_good_for_some_frames() -> None:
    memory = beside_the_dark()
    for failed in (True, False, True):
        frame(memory, (5, 5, DARK), *([(5, 6, DARK)] if failed else []))
    for _ in range(FRAMES):
        assert frame(memory, (5, 5, DARK))[5, 6] == BESIDE
    assert frame(memory, (5, 5, DARK))[5, 6] == 0


def test_a_node_beside_the_dark_is_held_whatever_it_fails_by_and_one_far_away_is_not() -> None:
    memory = beside_the_dark()
    for _ in range(2):
        frame(memory, (5, 5, DARK), (5, 7, AMBIGUOUS), (5, 9, AMBIGUOUS))
        flags = frame(memory, (5, 5, DARK))
    assert flags[5, 7] == BESIDE
    assert flags[5, 9] == 0


def test_beside_a_place_that_went_dark_just_now_nothing_is_held() -> None:
    """A sudden press: light goes and comes back all over it."""
    memory = BesideDark((12, 12), PERIOD_PX)
    for failed in (True, False, True, False):
        flags = frame(memory, (5, 5, DARK), *([(5, 6, DARK)] if failed else []))
    assert flags[5, 6] == 0


def test_without_a_dark_place_nothing_is_held() -> None:
    memory = BesideDark((12, 12), PERIOD_PX)
    for _ in range(3):
        frame(memory, (5, 5, AMBIGUOUS))
        assert not frame(memory).any()


def test_sigma_grows_beside_the_dark_by_the_share_of_the_window_that_is_dark() -> None:
    """The phase error is a share of the window times a random phasor: rms over the places of the edge."""
    sigma = np.full((12, 12, 2), 0.01)
    flags = np.zeros((12, 12), np.uint16)
    flags[5, 5] = DARK
    out = BesideDark((12, 12), PERIOD_PX).flag(flags, sigma)
    period = 2 * np.pi / PERIOD_PX
    for away, (nearest, furthest) in enumerate(((1.0, 1.5), (1.5, 2.0)), start=1):
        edge = np.linspace(nearest, furthest, 101)
        share = (1 - edge / 2) ** 2 / 2
        rms = np.sqrt(np.mean(share**2) / 2)
        # on the careful side, as what is left of the residual adds to it
        assert 1.0 <= EDGE_RAD[away - 1] / rms < 1.6
        np.testing.assert_allclose(out[5, 5 + away], np.hypot(0.01, EDGE_RAD[away - 1] / period))
    assert (out[5, 8:] == 0.01).all()
    assert (BesideDark((12, 12), PERIOD_PX).flag(np.zeros((12, 12), np.uint16), sigma) == sigma).all()
