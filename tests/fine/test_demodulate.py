import numpy as np
import pytest

from zeromethod.errors import InputError
from zeromethod.fine.demodulate import Design, demodulate
from zeromethod.fine.frames import Steps
from zeromethod.fine.lateness import lateness
from zeromethod.rig.model import Noise

SHAPE, PERIOD = (96, 256), 16
SCAN = np.linspace(-0.5, 0.5, SHAPE[0])
K = 2 * np.pi / PERIOD


def to_and_fro(count: int, start: int = 0, late_turn: int = 8) -> list[Steps]:
    """Steps of a 16th of a period along u and an 8th along v, to and fro, at 60 per second; v turns later."""
    frames, ones = np.arange(start, start + count), np.ones((SHAPE[0], 2))
    places = np.stack([frames, frames + late_turn], axis=-1) % 32
    phases = 2 * np.pi / 16 * np.minimum(places, 32 - places) * (1, 2)
    rates = 60 * 2 * np.pi / 16 * np.where((places > 0) & (places <= 16), 1.0, -1.0) * (1, 2)
    return [Steps(p * ones, 0.95 * ones, r * ones) for p, r in zip(phases, rates, strict=True)]


def images_of(
    steps: list[Steps], d: np.ndarray, noise: float, late_s: np.ndarray | None = None
) -> np.ndarray:
    rng = np.random.default_rng(1)
    late_s = np.zeros(len(steps)) if late_s is None else late_s
    v, u = np.mgrid[: SHAPE[0], : SHAPE[1]]
    out = []
    for one, late in zip(steps, late_s, strict=True):
        phase = one.phase_rad + np.atleast_1d(late)[:, None] * one.per_late_rad
        light = 120 + 50 * one.contrast[:, :1] * np.cos(K * (u + d[..., 0]) + phase[:, :1])
        light += 50 * one.contrast[:, 1:] * np.cos(K * (v + d[..., 1]) + phase[:, 1:])
        out.append(np.rint(light + noise * rng.standard_normal(SHAPE)).astype(np.uint8))
    return np.array(out)


def planted() -> np.ndarray:
    v, u = np.mgrid[: SHAPE[0], : SHAPE[1]]
    return np.stack([0.4 * np.sin(u / 3.0), 0.3 * np.cos(v / 4.0)], axis=-1)


@pytest.mark.parametrize(("count", "start"), [(32, 0), (16, 8), (24, 3)])
def test_each_pixel_is_read_with_the_scatter_that_is_stated(count, start):
    steps = to_and_fro(count, start)
    found = demodulate(images_of(steps, planted(), 2.0), Design.of(steps), PERIOD, Noise(read_grey=2.0))
    scatter = (found.d - planted()).std(axis=(0, 1))
    # 25,000 pixels: their scatter is known to 0.5 %, and an ill-conditioned fit bends
    np.testing.assert_allclose(scatter, np.sqrt(found.variance.mean(axis=(0, 1))), rtol=0.05)


def test_ideal_phases_reach_the_bound():
    steps = to_and_fro(32)
    found = demodulate(images_of(steps, planted(), 2.0), Design.of(steps), PERIOD, Noise(read_grey=2.0))
    bound = np.sqrt((2.0**2 + 1 / 12) * 2 / 32) / (K * 50 * 0.95)
    np.testing.assert_allclose(np.sqrt(found.variance.mean(axis=(0, 1))), bound, rtol=0.01)


def test_sixteen_frames_may_be_ill_conditioned_and_twenty_four_never_are():
    def worst_gain(count: int) -> float:
        return max(
            np.sqrt(np.diagonal(Design.of(to_and_fro(count, start)).covariance[0])[1:].max() * count / 2)
            for start in range(32)
        )

    assert worst_gain(24) < 1.3
    assert worst_gain(16) > 5.0


def test_phases_that_do_not_determine_a_pixel_are_refused():
    with pytest.raises(InputError, match="do not determine"):
        Design.of([Steps.constant(4, 0.1 * t, 0.1 * t) for t in range(8)])


def test_pictures_that_came_late_are_found_and_taken_out():
    steps, late_s = to_and_fro(24), 1e-4 * (1 + np.random.default_rng(2).standard_normal(24))
    images, noise = images_of(steps, planted(), 0.5, late_s), Noise()
    found_s = lateness(images, steps, Design.of(steps), 0.6, SCAN)
    # 3,000 px at 0.6 grey of 50, 24 and 47 rad/s: 6 us, some times that where unknowns are in the way
    np.testing.assert_allclose(found_s.mean(axis=1), late_s, atol=6e-5)
    left, found = (
        (demodulate(images, Design.of(steps, late), PERIOD, noise).d - planted()).mean(axis=(0, 1))
        for late in (None, found_s)
    )
    # 0.1 ms is 6 and 12 mpx in a frame
    assert np.abs(left).max() > 2e-3
    # 24 frames of those 6 us and more, and rounded codes
    assert np.abs(found).max() < 8e-4


def test_the_codes_of_strips_are_not_taken_for_pictures_that_came_late():
    steps = to_and_fro(24)
    images, codes = images_of(steps, planted(), 0.5), np.random.default_rng(4)
    images[:, :24] = np.repeat(codes.integers(40, 200, (24, 1, 32)), 8, axis=2)
    with_codes, without = (
        lateness(images, steps, Design.of(steps), 0.6, SCAN, box)
        for box in (None, (slice(24, 96), slice(0, 256)))
    )
    # as pictures that came late are found to, from three quarters of the rows
    assert np.abs(without).max() < 7e-5
    assert np.abs(with_codes).max() > 5e-4


def test_a_mirror_that_moves_steadily_is_not_taken_for_pictures_that_came_late():
    steps = to_and_fro(24)
    far = np.zeros((*SHAPE, 2))
    far[:, :128] = 0.5, -0.3
    moving = [images_of([one], planted() + t / 24 * far, 0.5)[0] for t, one in enumerate(steps)]
    found_s = lateness(moving, steps, Design.of(steps), 0.6, SCAN)
    # taken for it, half a pixel of half the view would be 0.5 to 2 ms; 6 us in a frame, and second order
    assert np.abs(found_s).max() < 4e-5


def test_rows_that_are_scanned_more_slowly_than_assumed_are_found():
    steps, late_s = to_and_fro(24), 1e-3 * (0.5 + np.tile(SCAN, (24, 1)))
    images, noise = images_of(steps, planted(), 0.5, late_s), Noise()
    found_s = lateness(images, steps, Design.of(steps), 0.6, SCAN)
    # as above in the mean over rows; over the panel 3.5 times the mean's noise, of 24 frames together
    np.testing.assert_allclose(found_s - found_s.mean(axis=0), 0.0, atol=1e-4)
    np.testing.assert_allclose(np.ptp(found_s.mean(axis=0)), 1e-3, atol=4e-5)
    left, found = (
        (demodulate(images, Design.of(steps, late), PERIOD, noise).d - planted()).mean(axis=1)
        for late in (None, found_s)
    )
    # 1 ms is 0.06 and 0.12 px in a frame; 24 of them, to and fro, leave some of it
    assert np.ptp(left, axis=0).max() > 1e-2
    # a row's 256 pixels of 0.5 grey in 24 frames are known to 0.5 mpx, and each lateness to 1 mpx
    assert np.abs(found).max() < 4e-3


def test_carriers_that_turn_together_hide_what_came_late():
    steps = to_and_fro(32, late_turn=0)
    late_s = 1e-4 * np.sign([one.per_late_rad[0, 0] for one in steps])
    images = images_of(steps, planted(), 0.0, late_s)
    found_s = lateness(images, steps, Design.of(steps), 0.3, SCAN)
    assert np.abs(found_s).max() < 2e-5


def test_the_weights_of_frames_are_those_of_their_displacements():
    steps = to_and_fro(24, 3)
    design, moved = Design.of(steps), 0.01 * np.arange(24)
    images = [images_of([one], planted() + by, 0.0)[0] for one, by in zip(steps, moved, strict=True)]
    still = images_of(steps, planted(), 0.0)
    apart = [
        demodulate(np.array(one), design, PERIOD, Noise()).d.mean(axis=(0, 1)) for one in (images, still)
    ]
    # codes are rounded: 0.3 grey in 50 over 25,000 pixels; second order in the motion
    np.testing.assert_allclose(apart[0] - apart[1], design.weights @ moved, atol=3e-3)
