"""Fresnel reflectance and polarisation against known values."""

import numpy as np
import pytest

from zeromethod.optics import critical_angle_rad, fresnel
from zeromethod.optics.fresnel import s_share
from zeromethod.optics.vectors import unit

from .optics_shapes import close


def test_critical_angle_of_silicone_rubber():
    assert np.degrees(critical_angle_rad(1.41)) == pytest.approx(45.17, abs=0.005)  # the seed paper's figure
    assert critical_angle_rad(1.0, 1.41) == pytest.approx(np.pi / 2)


def test_reflectance_just_below_total_reflection():
    s, p = fresnel(np.cos(np.radians([45.0, 43.6])), 1.41, 1.0)
    # two printed digits: the known values at 45 deg and, unpolarised, at 43.6 deg
    assert s[0] == pytest.approx(0.73, abs=0.005)
    assert p[0] == pytest.approx(0.54, abs=0.005)
    assert (s[1] + p[1]) / 2 == pytest.approx(0.27, abs=0.005)


def test_normal_incidence():
    s, p = fresnel(np.ones(1), 1.41, 1.0)
    expected = ((1.41 - 1.0) / (1.41 + 1.0)) ** 2
    np.testing.assert_allclose([s[0], p[0]], expected, rtol=1e-14)


def test_total_reflection_is_total_up_to_grazing():
    angle = np.radians([45.1732, 50.0, 80.0, 90.0])
    for reflectance in fresnel(np.append(np.cos(angle), 0.0), 1.41, 1.0):
        np.testing.assert_array_equal(reflectance, 1.0)


def test_p_light_passes_at_brewsters_angle():
    _, p = fresnel(np.cos(np.arctan([1.41])), 1.0, 1.41)
    assert p[0] < 1e-30


def test_both_directions_through_an_interface_reflect_alike():
    inside = np.radians(np.linspace(0.0, 45.0, 50))
    outside = np.arcsin(1.41 * np.sin(inside))
    close(fresnel(np.cos(inside), 1.41, 1.0), fresnel(np.cos(outside), 1.0, 1.41), 1e-12)


def test_energy_is_kept():
    """R + T = 1, with T from Fresnel's transmission amplitudes and the beams' widths."""
    inside = np.radians(np.linspace(0.0, 45.0, 50))
    n1, n2, c1 = 1.41, 1.0, np.cos(inside)
    c2 = np.sqrt(1 - (n1 * np.sin(inside)) ** 2)
    t_s, t_p = 2 * n1 * c1 / (n1 * c1 + n2 * c2), 2 * n1 * c1 / (n2 * c1 + n1 * c2)
    for reflectance, t in zip(fresnel(c1, n1, n2), (t_s, t_p), strict=True):
        close(reflectance + n2 * c2 / (n1 * c1) * t**2, 1.0, 1e-13)


def test_field_across_the_plane_of_incidence_is_s_and_in_it_p():
    travel, normal = unit(np.array([0.7, 0.0, 0.7])), np.array([0.0, 0.0, 1.0])
    assert s_share(travel, normal, np.array([0.0, 1.0, 0.0])) == pytest.approx(1.0)
    assert s_share(travel, normal, np.array([0.7, 0.0, -0.7])) == pytest.approx(0.0)
    assert s_share(travel, normal, np.array([0.5, 1.0, -0.5])) == pytest.approx(1.0 / 1.5)
    assert s_share(normal, normal, np.array([0.3, 0.4, 0.0])) == pytest.approx(0.5)
