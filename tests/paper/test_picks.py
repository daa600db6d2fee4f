"""Lattice crossings against the closed form of the warp that drew them."""

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from zeromethod.errors import MeasurementError
from zeromethod.paper.picks import find_crossings, pick

PERIOD, ORIGIN, SHAPE = 25.0, (20.0, 15.5), (220, 340)
LINE = 4.0


def bump(u, v, shift_px, centre=(170.0, 110.0), sigma=60.0):
    """Displacement (du, dv) of what is seen at (u, v): along u, largest at the centre."""
    r2 = (u - centre[0]) ** 2 + (v - centre[1]) ** 2
    return shift_px * np.exp(-r2 / (2 * sigma**2)), np.zeros_like(u)


def lattice_image(shift_px=0.0, light=lambda u, v: 1.0, noise=0.0):
    """Dark lines where u + du (v + dv) lies within LINE / 2 of a lattice line, blurred by 0.7 px."""
    fine = 4
    v, u = (np.arange(fine * n) / fine - 0.5 + 0.5 / fine for n in SHAPE)
    u, v = np.meshgrid(u, v)
    du, dv = bump(u, v, shift_px)
    places = (u + du - ORIGIN[0], v + dv - ORIGIN[1])
    off = [np.abs((place + PERIOD / 2) % PERIOD - PERIOD / 2) for place in places]
    lit = [np.clip(fine * (each - LINE / 2) + 0.5, 0.0, 1.0) for each in off]
    grey = (10.0 + 150.0 * lit[0] * lit[1]) * light(u, v)
    grey = gaussian_filter(grey, 0.7 * fine).reshape(SHAPE[0], fine, SHAPE[1], fine).mean(axis=(1, 3))
    return grey + noise * np.random.default_rng(1).standard_normal(SHAPE)


def true_places(index, shift_px):
    """Where the crossings are seen: u + du(u, v) = their place at rest."""
    rest = np.array(ORIGIN) + PERIOD * index
    seen = rest.copy()
    for _ in range(200):
        du, dv = bump(seen[:, 0], seen[:, 1], shift_px)
        seen = rest - np.stack([du, dv], axis=-1)
    return seen


def test_crossings_at_rest_are_found_to_a_twentieth_of_a_pixel():
    found = find_crossings(lattice_image(noise=1.5), PERIOD)
    index = np.rint((found - ORIGIN) / PERIOD)
    # 1 % noise over edges of about 150 grey per px, 6 edge samples a place: 0.01 px rms; 0.05 is five sigma.
    assert np.max(np.abs(found - ORIGIN - PERIOD * index)) < 0.05
    assert len(np.unique(index, axis=0)) == len(found) >= 12 * 8


@pytest.mark.parametrize("shift_px", [8.0, -14.0, 30.0])
def test_crossings_are_followed_through_more_than_a_period(shift_px):
    picks = pick(lattice_image(), lattice_image(shift_px, noise=1.5), PERIOD, ORIGIN)
    # Lines bend by |shift| / 60^2 / (1 - 0.6 |shift| / 60) per px, and are looked at 4 to 6 px away from the
    # crossing (mean square 25.7); uneven stretch of their own 4 px adds 2^2; 0.06 px for noise, five sigma.
    bend = abs(shift_px) / 60**2 / (1 - 0.6 * abs(shift_px) / 60)
    assert np.max(np.abs(picks.after - true_places(picks.index, shift_px))) < (25.7 + 4) / 2 * bend + 0.06
    assert {5, 6, 7} <= set(picks.line(4).index[:, 0]), "the middle, where the shift is largest, is followed"


def test_a_step_of_brightness_through_a_line_does_not_move_it():
    step = lattice_image(light=lambda u, v: np.where(u < 170.0, 1.0, 0.6), noise=0.5)
    picks = pick(lattice_image(), step, PERIOD, ORIGIN)
    on_step = np.abs(picks.before[:, 0] - 170.0) < 1.0
    assert on_step.any()
    # Half-way levels of each edge's own side: only the lens's blur of the step inside the line is left.
    assert np.max(np.abs(picks.after - picks.before)[on_step]) < 0.1


def test_a_line_comes_out_in_order_and_whole_picks_are_whole():
    picks = pick(lattice_image(), lattice_image(8.0), PERIOD, ORIGIN)
    line = picks.line(3)
    assert np.all(np.diff(line.index[:, 0]) > 0)
    assert np.all(line.index[:, 1] == 3)
    whole = line.whole()
    assert np.array_equal(whole.after, np.rint(whole.after))
    assert np.max(np.abs(whole.after - line.after)) <= 0.5


def test_crossings_behind_a_blot_are_left_out_and_the_others_keep_their_numbers():
    def blot(u, v):
        return np.where(np.hypot(u - 170.0, v - 115.0) < 45.0, 0.02, 1.0)

    picks = pick(lattice_image(), lattice_image(light=blot), PERIOD, ORIGIN)
    assert not np.any(np.hypot(*(picks.after - (170.0, 115.0)).T) < 35.0)
    # Nothing moves: a wrong number would stand a period away.
    assert np.max(np.abs(picks.after - picks.before)) < 1.0


@pytest.mark.parametrize(("before", "after", "which"), [(False, True, "before"), (True, False, "after")])
def test_an_image_without_a_lattice_is_refused(before, after, which):
    images = [lattice_image() if drawn else np.full(SHAPE, 100.0) for drawn in (before, after)]
    with pytest.raises(MeasurementError, match=f"no lattice is visible in the image {which}"):
        pick(*images, PERIOD, ORIGIN)
