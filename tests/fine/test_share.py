import numpy as np
from planted_frames import to_and_fro

from zeromethod.fine.blend import fine_share
from zeromethod.fine.motion import Readings

SIGMA_PX, SHAPE = 0.007, (20, 24)


def share(moved: np.ndarray, frames: int = 24) -> np.ndarray:
    """Share of nodes at rest but for `moved` (N,), which a target to and fro has seen, and noise."""
    scatter = SIGMA_PX * np.random.default_rng(0).standard_normal((frames, *SHAPE, 2))
    d = moved[:, None, None, None] + scatter
    variance = np.full((*SHAPE, 2), SIGMA_PX**2)
    turns = np.repeat(to_and_fro(frames)[:, None], SHAPE[0], axis=1)
    times = np.arange(float(frames))
    return fine_share(Readings.of(d, variance, np.ones(SHAPE, bool), turns, times))


def test_what_a_fine_shape_makes_at_the_targets_phases_is_no_motion():
    # chance alone is kept below 4 deviations of the pooled scatter
    assert share(np.zeros(24)).min() > 0.95
    p, q = to_and_fro(24).T
    assert share(0.1 * np.cos(p + q)).min() > 0.95


def test_motion_is_seen_though_it_has_a_part_at_those_to_and_fro():
    drift = 5 * SIGMA_PX * np.linspace(-1.0, 1.0, 24)
    # the mean is 5 sigma off: w = 1 / (1 + 25), known to a tenth but for what chance is forgiven
    assert 0.03 < share(drift).mean() < 0.05
    step = 5 * SIGMA_PX * np.where(np.arange(24) < 12, -1.0, 1.0)
    assert share(step).max() < 0.1
