import numpy as np

from zeromethod.fine.blend import fine_share

SIGMA_PX, SHAPE = 0.007, (20, 24)


def share(moved: np.ndarray, frames: int = 24) -> np.ndarray:
    """Share of nodes at rest but for `moved` (N,), which a target to and fro has seen, and noise."""
    scatter = SIGMA_PX * np.random.default_rng(0).standard_normal((frames, *SHAPE, 2))
    d = moved[:, None, None, None] + scatter
    variance = np.full((*SHAPE, 2), SIGMA_PX**2)
    turns = np.repeat(phases(frames)[:, None], SHAPE[0], axis=1)
    return fine_share(d, variance, np.ones(SHAPE, bool), turns)


def phases(frames: int) -> np.ndarray:
    places = np.stack([np.arange(frames), np.arange(frames) + 8], axis=-1) % 32
    return 2 * np.pi / 16 * np.minimum(places, 32 - places) * (1, 2)


def test_what_a_fine_shape_makes_at_the_targets_phases_is_no_motion():
    # chance alone is kept below 4 deviations of the pooled scatter
    assert share(np.zeros(24)).min() > 0.95
    p, q = phases(24).T
    assert share(0.1 * np.cos(p + q)).min() > 0.95


def test_motion_is_seen_though_it_has_a_part_at_those_phases():
    drift = 5 * SIGMA_PX * np.linspace(-1.0, 1.0, 24)
    # of variance (5 sigma)^2 / 3: w = 1 / (1 + 8.3), known to a few percent but for what chance is forgiven
    assert 0.08 < share(drift).mean() < 0.16
    step = 5 * SIGMA_PX * np.where(np.arange(24) < 12, -1.0, 1.0)
    assert share(step).max() < 0.1
