"""The simulated bench's half-space beside the readers', written apart from it; and its force in balance."""

import numpy as np
import pytest

from zeromethod.mechanics.boussinesq import HalfSpaceForce
from zeromethod.simulation.elements.half_space import displacement, stress


@pytest.mark.parametrize("poisson", [0.0, 0.3, 0.5])
def test_it_is_the_readers_half_space(poisson):
    x, y, z = np.random.default_rng(1).uniform([[-5.0], [-5.0], [0.0]], 5.0, (3, 200))
    x[0] = y[0] = 0.0  # below the force
    reader = HalfSpaceForce(0.7, poisson)
    np.testing.assert_allclose(displacement(x, y, z, 0.7, poisson), reader.displacement(x, y, z), rtol=1e-9)
    np.testing.assert_allclose(stress(x, y, z, poisson), reader.stress(x, y, z), rtol=1e-9, atol=1e-12)


def test_a_plane_below_carries_the_force():
    at, weight = np.polynomial.legendre.leggauss(200)
    r, weight = 20.0 * (1 + at), 20.0 * weight
    normal = stress(r, np.zeros(200), np.full(200, 2.0), 0.4)[2, 2]
    # 1 - (2 / 40)^3 of it within 40 mm
    assert (2 * np.pi * r * weight * normal).sum() == pytest.approx(-1.0, abs=2e-4)
