"""A force inside endless rubber: in balance with what pulls around it, and stressed as it is strained."""

import numpy as np

from zeromethod.mechanics.kelvin import displacement, traction

SHEAR, POISSON = 0.4, 0.45


def test_a_sphere_around_the_force_pulls_back_as_much():
    cos, weight = np.polynomial.legendre.leggauss(12)
    turn = np.arange(24) * 2 * np.pi / 24
    sin = np.sqrt(1 - cos**2)
    normal = np.stack(
        [np.outer(sin, np.cos(turn)), np.outer(sin, np.sin(turn)), np.outer(cos, np.ones(24))]
    ).reshape(3, -1)
    area = 4.0 * np.repeat(weight, 24) * 2 * np.pi / 24  # of a sphere of 2 mm
    whole = (traction(2.0 * normal, normal, POISSON) * area).sum(axis=-1)
    # quadrature is exact for these polynomials
    np.testing.assert_allclose(whole, -np.eye(3), atol=1e-12)


def test_stress_is_hookes_of_the_displacement():
    at, normal, step = np.array([1.0, -0.7, 0.4]), np.array([0.6, 0.0, 0.8]), 1e-4
    strain = np.empty((3, 3, 3))
    for k in range(3):
        to = at + step * np.eye(3)[k]
        back = at - step * np.eye(3)[k]
        strain[:, k] = (displacement(to, SHEAR, POISSON) - displacement(back, SHEAR, POISSON)) / (2 * step)
    wider = np.einsum("kkj->j", strain) * 2 * SHEAR * POISSON / (1 - 2 * POISSON)
    stress = SHEAR * (strain + strain.transpose(1, 0, 2)) + np.eye(3)[:, :, None] * wider
    # differences of 1e-4 mm are exact to their square
    found = np.einsum("ikj,k->ij", stress, normal)
    np.testing.assert_allclose(traction(at, normal, POISSON), found, atol=1e-6)
