import numpy as np
import pytest

from benchmarks.peers import cosine_transform, frankot_chellappa

ROWS, COLS = 96, 128


def gaussian(sigma=12.0, at=(60.0, 50.0)):
    v, u = np.mgrid[:ROWS, :COLS].astype(float)
    depth = np.exp(-((u - at[0]) ** 2 + (v - at[1]) ** 2) / (2 * sigma**2))
    return depth, -(u - at[0]) / sigma**2 * depth, -(v - at[1]) / sigma**2 * depth


@pytest.mark.parametrize(
    ("integrate", "within"),
    [
        # Exact derivatives in the band; what the Gaussian still has at the border (3.7 sigma) is 1e-3.
        (frankot_chellappa.integrate, 5e-4),
        # Trapezoids: h^2/12 of the second derivative, 1 / (12 x 12^2) = 6e-4 of the peak there.
        (cosine_transform.integrate, 6e-4),
    ],
)
def test_a_gaussian_comes_back_with_its_sign(integrate, within):
    depth, across, down = gaussian()
    read = integrate(across, down)
    assert np.std(read - depth) < within


@pytest.mark.parametrize("integrate", [frankot_chellappa.integrate, cosine_transform.integrate])
def test_a_tilted_plane_is_not_taken_for_a_periodic_one(integrate):
    across, down = np.full((ROWS, COLS), 0.5), np.full((ROWS, COLS), -0.25)
    read = integrate(across, down)
    v, u = np.mgrid[:ROWS, :COLS]
    plane = 0.5 * u - 0.25 * v
    # Without mirroring a plane comes back flat, wrong by all of its spread; mirrored it is a tent, whose
    # corners ring by a few tenths of a node's step.
    assert np.std(read - plane) < 0.02 * np.std(plane)
