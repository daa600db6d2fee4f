"""A half-space under a force: equilibrium, a free surface, and stress as Hooke has it."""

import numpy as np
import pytest

from zeromethod.mechanics.boussinesq import HalfSpaceForce

STEP = 1e-4


def gradient(of, at):
    """d of / d axis by central differences, (..., 3)."""
    return np.stack([(of(*(at + s)) - of(*(at - s))) / (2 * STEP) for s in STEP * np.eye(3)], axis=-1)


@pytest.mark.parametrize("poisson", [0.2, 0.49])
def test_stress_follows_from_displacement_and_is_in_equilibrium(poisson):
    force, at = HalfSpaceForce(0.7, poisson), np.array([1.3, -0.4, 0.9])
    strain = gradient(force.displacement, at)
    bulk = 2 * 0.7 * poisson / (1 - 2 * poisson)
    hooke = 0.7 * (strain + strain.T) + bulk * np.trace(strain) * np.eye(3)
    # differences over 2e-4 mm; at 0.49 the dilatation, a difference of strains, is multiplied by 49
    np.testing.assert_allclose(force.stress(*at), hooke, atol=1e-6)
    np.testing.assert_allclose(np.trace(gradient(force.stress, at), axis1=1, axis2=2), 0.0, atol=1e-6)


def test_the_surface_is_free_and_yields_as_the_solver_s_half_space_does():
    force, away = HalfSpaceForce(0.7, 0.49), np.array([0.5, 2.0, 7.0])
    zero = np.zeros(3)
    np.testing.assert_allclose(force.stress(away, zero, zero)[2], 0.0, atol=1e-12)
    modulus = 2 * 0.7 / (1 - 0.49)  # E / (1 - nu^2)
    np.testing.assert_allclose(force.displacement(away, zero, zero)[2], 1 / (np.pi * modulus * away))
