import numpy as np
import pytest
from planted_frames import PlantedFrames, to_and_fro
from surface_bench import Load

from benchmarks.rigs import small_rig
from zeromethod.fine.motion import Motion, Readings, left_late_s

SIGMA_PX, SHAPE, FRAMES = 0.007, (40, 48), 24
TIMES = np.arange(float(FRAMES))
WEIGHTS = np.full((2, FRAMES), 1.0 / FRAMES)
ROWS, COLS = np.mgrid[-1.0 : 1.0 : SHAPE[0] * 1j, -1.0 : 1.0 : SHAPE[1] * 1j]
DENT = np.exp(-4.0 * (ROWS**2 + COLS**2))[..., None] * np.ones(2)


def motion_of(moved: np.ndarray, seed: int) -> tuple[Motion, np.ndarray]:
    """Motion of nodes that moved so far (N, rows, cols, 2), seen with noise, and the noise."""
    noise = SIGMA_PX * np.random.default_rng(seed).standard_normal((FRAMES, *SHAPE, 2))
    turns = np.repeat(to_and_fro(FRAMES)[:, None], SHAPE[0], axis=1)
    variance = np.full((*SHAPE, 2), SIGMA_PX**2)
    seen = Readings.of(moved + noise, variance, np.ones(SHAPE, bool), turns, TIMES)
    return Motion.of(seen, variance, WEIGHTS), noise


def over_time(power: int) -> np.ndarray:
    """A dent that grows by 1 camera px as this power of time."""
    return (TIMES[:, None, None, None] / TIMES[-1]) ** power * DENT


def test_a_mirror_that_stands_is_read_by_the_mean():
    for seed in range(8):
        motion, _ = motion_of(np.zeros((FRAMES, *SHAPE, 2)), seed)
        assert motion.degree == 0
        assert not motion.ahead.any()


@pytest.mark.parametrize("power", [1, 2])
def test_where_nodes_are_now_is_as_uncertain_as_stated(power):
    moved = over_time(power)
    motion, noise = motion_of(moved, 0)
    assert motion.degree == power
    ahead = moved[-1] - moved.mean(axis=0)
    error = motion.ahead + noise.mean(axis=0) - ahead
    stated = SIGMA_PX * np.sqrt(motion.excess[0] + 1.0 / FRAMES)
    # 4,000 numbers of chance
    assert np.std(error) == pytest.approx(stated, rel=0.05)
    assert np.abs(np.mean(error[DENT > 0.5])) < 0.1 * stated


def test_a_drift_that_the_noise_of_every_node_hides_is_seen():
    # the mean is late by 0.6 of a frame's noise at most, and 3 times its own
    assert motion_of(1.2 * SIGMA_PX * over_time(1), 0)[0].degree == 1


def test_a_lateness_left_all_over_the_view_is_told_from_steady_motion():
    # of the steps of `to_and_fro`, in px/s at 60 frames a second
    steps_px = 16.0 / (2.0 * np.pi) * np.gradient(to_and_fro(FRAMES), axis=0)
    per_late = np.broadcast_to(60.0 * steps_px[:, None, None], (FRAMES, *SHAPE, 2))
    seen = 3e-5 * per_late + SIGMA_PX * np.random.default_rng(0).standard_normal(per_late.shape)
    valid = np.ones(SHAPE, bool)
    # nodes so many know it to 1 us, and to 2 where a dent of a px grows
    assert left_late_s(seen, per_late, valid, TIMES) == pytest.approx(3e-5, abs=4e-6)
    assert left_late_s(seen + over_time(1), per_late, valid, TIMES) == pytest.approx(3e-5, abs=8e-6)


def test_what_whole_frames_are_off_by_at_random_is_no_motion():
    # as the noise of their lateness: for 169 nodes together 4 times their noise, where 5 times it is motion
    degrees = []
    for seed in range(20):
        off_px = SIGMA_PX * np.random.default_rng(100 + seed).standard_normal((FRAMES, 1, 1, 2))
        degrees.append(motion_of(np.broadcast_to(off_px, (FRAMES, *SHAPE, 2)), seed)[0].degree)
    assert degrees == 20 * [0]


def test_depth_of_a_dent_that_slides_is_as_wrong_as_stated():
    bench = PlantedFrames(small_rig(4))
    mirrors = [Load(5e-3, 40.0 + 0.05 * t, 0.0, 5.0) for t in range(FRAMES)]
    turns = [(float(u), float(v)) for u, v in to_and_fro(FRAMES)]
    surface = bench.reader.read(bench.frames(mirrors, turns, noise=2.0))
    true = mirrors[-1].depth(surface.x_mm.astype(float), surface.y_mm.astype(float))
    wrong = ((surface.depth_mm - true) / surface.sigma_depth_mm)[surface.valid]
    # some thirty independent parts; by the mean of the frames it is 2.5 times sigma
    assert 0.3 < np.sqrt(np.mean(wrong**2)) < 1.2
