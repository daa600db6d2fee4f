"""What dirt does to nodes is learned at rest and taken off; everything else stays."""

import numpy as np
import pytest

from zeromethod.loop.state import State
from zeromethod.session.dirt import FRAMES, DirtCorrection
from zeromethod.warp.warp import Warp

SHAPE = (40, 60)
ROW, COL = np.indices(SHAPE)
REST = np.stack([20.0 * COL, 18.0 * ROW], axis=-1) + 1e-3 * (ROW * COL)[..., None]
SIGMA = 0.01
DIRT = np.zeros((*SHAPE, 2))
DIRT[20:23, 30:33] = 0.2, -0.15
SLOW = 0.3 * np.sin(COL / 25)[..., None]
"""A rest that is not quite the rig's."""


def warp(seed, more=0.0, dirt=DIRT):
    noise = SIGMA * np.random.default_rng(seed).standard_normal(REST.shape)
    flags = np.zeros(SHAPE, np.uint16)
    flags[5, 5] = 8
    return Warp(REST + SLOW + dirt + more + noise, np.full(REST.shape, SIGMA), flags, seed)


def learned(**given):
    correction = DirtCorrection(REST)
    correction.corrected(warp(98, **given), State.NULLING, None)
    for seed in range(FRAMES):
        correction.corrected(warp(seed, **given), State.RESTING, None)
    return correction


def test_what_dirt_does_is_taken_off_in_presses_too_and_left_open_in_sigma():
    press = 3 * np.exp(-((COL - 30) ** 2 + (ROW - 20) ** 2) / 200)[..., None]
    found = learned().corrected(warp(99, press), State.LOCKED, None)
    off = found.q - REST - SLOW - press
    disturbed = DIRT[..., 0] > 0
    # noise of one frame, of sixteen, and the slow rest's curvature over the square that is the measure
    assert np.sqrt(np.mean(off[disturbed] ** 2)) < 1.5 * SIGMA
    assert (found.sigma[disturbed] > 0.25 * 0.2).all()
    far = (np.abs(COL - 31) > 8) | (np.abs(ROW - 21) > 8)
    assert np.sqrt(np.mean(off[far] ** 2)) == pytest.approx(SIGMA, rel=0.1)
    # four deviations leave some clean node in a hundred thousand, and a slow rest bends a little
    assert np.quantile(found.sigma[far], 0.98) < 1.1 * SIGMA


def test_a_clean_rest_changes_nothing():
    correction = learned(dirt=0.0)
    given = warp(99, dirt=0.0)
    assert correction.corrected(given, State.RESTING, None) is given or np.abs(
        correction.corrected(given, State.RESTING, None).q - given.q
    ).max() < (5 * SIGMA)


def test_what_all_nodes_are_off_is_left_open_though_none_shows_it():
    # as large as one frame's noise: four deviations of the mean of sixteen
    threads = SIGMA * np.random.default_rng(97).standard_normal(REST.shape)
    found = learned(dirt=threads).corrected(warp(99, dirt=threads), State.LOCKED, None)
    off = (found.q - REST - SLOW)[8:-8, 8:-8]
    # a third shows, which is left open by what each is off; among 2,400 nodes a mean square is known to 3 %
    assert np.mean(found.sigma[8:-8, 8:-8] ** 2) == pytest.approx(np.mean(off**2), rel=0.1)
    assert found.sigma.min() > 1.05 * SIGMA


def test_under_a_cloth_it_is_left_open_before_any_rest_is_known_and_while_something_presses():
    threads = SIGMA * np.random.default_rng(97).standard_normal(REST.shape)
    press = 3 * np.exp(-((COL - 30) ** 2 + (ROW - 20) ** 2) / 200)[..., None]
    correction = DirtCorrection(REST, under_cloth=True)
    # 4,800 values know a mean square to 2 %; the press bends over the square that is the measure
    for seed, given in ((0, warp(0, dirt=threads)), (1, warp(1, press, dirt=threads))):
        found = correction.corrected(given, State.NULLING, None)
        assert np.median(found.sigma) == pytest.approx(2**0.5 * SIGMA, rel=0.1), seed
        assert np.array_equal(found.q, given.q)


def test_nothing_is_learned_while_something_presses():
    correction = DirtCorrection(REST)
    for seed in range(2 * FRAMES):
        correction.corrected(warp(seed), State.LOCKED, None)
    given = warp(99)
    assert correction.corrected(given, State.LOCKED, None) is given


def test_the_first_frame_at_rest_is_without_dirt_too_and_less_is_known_by_it():
    correction = DirtCorrection(REST)
    correction.corrected(warp(0), State.NULLING, None)
    first = correction.corrected(warp(1), State.RESTING, None)
    disturbed = DIRT[..., 0] > 0
    # what is left is the slow rest's curvature; a press begins, and the noise of that one frame comes with it
    assert np.abs(first.q - REST - SLOW)[disturbed].max() < 2 * SIGMA
    pressed = correction.corrected(warp(2, 1.0), State.NULLING, None)
    off = (pressed.q - REST - SLOW - 1.0)[disturbed]
    assert np.sqrt(np.mean(off**2)) == pytest.approx(2**0.5 * SIGMA, rel=0.4)
    assert (
        pressed.sigma[disturbed] > learned().corrected(warp(2, 1.0), State.NULLING, None).sigma[disturbed]
    ).all()


def test_a_press_that_begins_before_the_state_says_so_is_not_taken_for_dirt():
    correction = DirtCorrection(REST)
    correction.corrected(warp(0, dirt=0.0), State.NULLING, None)
    press = 3 * np.exp(-((COL - 30) ** 2 + (ROW - 20) ** 2) / 20)[..., None]
    begun = warp(1, 0.3 * press, dirt=0.0)
    assert correction.corrected(begun, State.RESTING, None) is begun
    pressed = warp(2, press, dirt=0.0)
    assert correction.corrected(pressed, State.LOCKED, None) is pressed


def test_a_new_zero_is_learned_again():
    correction = learned()
    zero = np.zeros_like(REST)
    given = warp(99, dirt=0.0)
    assert correction.corrected(given, State.LOCKED, zero) is given
