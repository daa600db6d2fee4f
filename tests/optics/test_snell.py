"""Refraction and reflection against the scalar laws."""

import numpy as np
import pytest

from zeromethod.optics import reflect, refract
from zeromethod.optics.vectors import dot, unit

NORMAL = np.array([0.0, 0.0, 1.0])


@pytest.mark.parametrize("sense", [1.0, -1.0])
@pytest.mark.parametrize(("n1", "n2"), [(1.0, 1.41), (1.41, 1.0), (1.5, 1.41)])
def test_refraction_obeys_snell_whatever_the_normals_sense(n1, n2, sense):
    angle = np.radians(np.linspace(0.0, 44.0, 45))
    direction = np.stack([np.sin(angle), np.zeros_like(angle), np.cos(angle)], axis=-1)
    out = refract(direction, sense * NORMAL, n1, n2)
    expected = np.arcsin(n1 / n2 * np.sin(angle))
    # 1e-14: a few roundings of numbers near 1
    np.testing.assert_allclose(out[:, 0], np.sin(expected), rtol=0, atol=1e-14)
    np.testing.assert_allclose(out[:, 2], np.cos(expected), rtol=0, atol=1e-14)


def test_beyond_the_critical_angle_nothing_is_refracted():
    angle = np.radians([45.1, 45.2])  # critical angle 45.17 deg at 1.41
    direction = np.stack([np.sin(angle), np.zeros(2), np.cos(angle)], axis=-1)
    out = refract(direction, NORMAL, 1.41, 1.0)
    assert np.isfinite(out[0]).all()
    assert np.isnan(out[1]).all()


def test_refraction_is_reversible_and_keeps_the_plane_of_incidence():
    rng = np.random.default_rng(1)
    direction, normal = unit(rng.normal(size=(500, 3))), unit(rng.normal(size=(500, 3)))
    inside = refract(direction, normal, 1.0, 1.41)
    back = refract(inside, normal, 1.41, 1.0)
    # 1e-9: going back from grazing rays loses half the digits of cos = sqrt(1 - sin^2)
    np.testing.assert_allclose(back, direction, rtol=0, atol=1e-9)
    np.testing.assert_allclose(dot(np.cross(direction, normal), inside), 0.0, rtol=0, atol=1e-15)
    np.testing.assert_allclose(dot(inside, inside), 1.0, rtol=0, atol=1e-14)


def test_reflection_turns_only_the_part_along_the_normal():
    direction = unit(np.array([[0.3, -0.2, 0.9]]))
    np.testing.assert_allclose(reflect(direction, NORMAL), direction * [1, 1, -1], rtol=0, atol=1e-16)
    np.testing.assert_allclose(reflect(direction, -NORMAL), direction * [1, 1, -1], rtol=0, atol=1e-16)


def test_nan_rows_pass_silently():
    direction = np.array([[np.nan] * 3, [0.0, 0.0, 1.0]])
    for result in (refract(direction, NORMAL, 1.41, 1.0), reflect(direction, NORMAL)):
        assert np.isnan(result[0]).all()
        assert np.isfinite(result[1]).all()
