"""Planted loads against closed forms and balances, and the limits that dents are drawn within."""

from math import exp, inf, pi, sqrt

import numpy as np
import pytest
from scipy.special import i0e, i1e

from benchmarks.anchors import LOADED, MARGIN_MM, View, pressed
from benchmarks.hand_presses import MOST_SLOPE
from benchmarks.loads import POISSON, PRESSURES, Load, Pressed
from benchmarks.rigs import small_rig
from zeromethod.simulation.elements.prism import PrismKernel
from zeromethod.simulation.shapes import ball, cone

R_MM = np.array([0.0, 0.5, 2.0, 5.5, 9.0, 30.0, 70.0])
ZERO = np.zeros_like(R_MM)
Q, CONTACT_MM = 0.4, 4.0


def along_x(kind: str, width_mm: float, thickness_mm: float = inf):
    depth, by_x, _ = Load(kind, Q, 0.0, 0.0, width_mm).field(R_MM, ZERO, thickness_mm)
    return depth, by_x


def test_a_gaussian_pressure_makes_the_dent_of_its_closed_form():
    depth, by_x = along_x("gaussian", 2.0)
    u, middle_mm = R_MM**2 / 16.0, Q / (2.0 * sqrt(2 / pi))
    # what is left out beyond 20 widths, 4e-7 of 1/r
    np.testing.assert_allclose(depth, middle_mm * i0e(u), rtol=1e-6)
    np.testing.assert_allclose(by_x, middle_mm * (i1e(u) - i0e(u)) * R_MM / 8.0, rtol=1e-5, atol=1e-12)


HERTZ_MM, SNEDDON_MM = 3 * pi * Q / (4 * CONTACT_MM), pi * Q / CONTACT_MM
"""Depths under the force: F = 4/3 E* a d0 and F = E* a d0."""


@pytest.mark.parametrize(
    ("kind", "closed", "within"),
    [
        ("ball", ball(R_MM, ZERO, HERTZ_MM, CONTACT_MM**2 / HERTZ_MM), 4e-3),
        ("cone", cone(R_MM, ZERO, SNEDDON_MM, CONTACT_MM), 0.13),
    ],
    ids=("ball", "cone"),
)
def test_hard_objects_make_hertzs_and_sneddons_dents_but_for_their_blur(kind, closed, within):
    depth, by_x = along_x(kind, CONTACT_MM / PRESSURES[kind].radius)
    true, true_by_x, _ = closed
    np.testing.assert_allclose(depth, true, atol=within * true[0])
    # far from the rim blur adds b^2 / 2 r^3 to 1 / r: 3 b^2 / 2 r^2 of the slope, and more nearby
    far = R_MM > 2 * CONTACT_MM
    blur = 2 * (PRESSURES[kind].blur * CONTACT_MM / R_MM[far]) ** 2
    assert (np.abs(by_x[far] / true_by_x[far] - 1) < blur).all()


def test_a_flat_punchs_face_is_flat_and_as_deep_as_its_force_makes_it():
    depth, _ = along_x("punch", CONTACT_MM / PRESSURES["punch"].radius)
    # F = 2 E* a d0; the blur of the rim lets its middle go by 2 %
    assert depth[0] == pytest.approx(pi * Q / (2 * CONTACT_MM), rel=0.03)
    assert depth[1] == pytest.approx(depth[0], rel=0.01)


@pytest.mark.parametrize("kind", PRESSURES)
def test_far_away_only_force_and_mean_square_radius_matter(kind):
    # q / r (1 + l^2 / 2 r^2), l^2 with the blur's; the next term is below 9 / 8 x 3 (a / r)^4
    width_mm, r = 1.5, np.array([25.0])
    depth, _, _ = Load(kind, Q, 0.0, 0.0, width_mm).field(r, 0 * r, inf)
    pressure = PRESSURES[kind]
    blur_mm = pressure.blur * pressure.radius * width_mm if kind != "gaussian" else 0.0
    assert depth[0] * r[0] / Q - 1 == pytest.approx((width_mm**2 + blur_mm**2) / (2 * r[0] ** 2), abs=2e-5)


def test_a_layer_as_a_whole_yields_to_compression_alone():
    # the volume of a bonded layer's dent is F T (1 - 2 nu)(1 + nu) / (E (1 - nu))
    r = np.linspace(0.0, 150.0, 60001)  # seven times as far as a layer of 5 mm passes pressure on
    depth, _, _ = Load("gaussian", Q, 0.0, 0.0, 4.0).field(r, 0 * r, 5.0)
    volume = 2 * pi * np.trapezoid(depth * r, r)
    expected = pi * Q * 5.0 * (1 - 2 * POISSON) / (1 - POISSON) ** 2
    assert volume == pytest.approx(expected, rel=0.01)


def test_a_prism_adds_what_its_kernel_has_for_the_force():
    # a kernel that is 1 + 0.1 u everywhere, u along the mirror
    coefficients = np.zeros((3, 4, 2, 2))
    coefficients[0, :2, 0, 0] = 1.0, 0.1
    load = Load("gaussian", Q, 30.0, 0.0, 3.0)
    prism = PrismKernel(80.0, 30.0, coefficients)
    whole, alone = Pressed((load,), prism=prism, scale=2.0), Pressed((load,), scale=2.0)
    x, y = np.array([20.0, 44.0]), np.array([-3.0, 9.0])
    force_n = 2.0 * pi * Q / (1 - POISSON**2)
    u = x / 40.0 - 1
    np.testing.assert_allclose(whole.depth(x, y) - alone.depth(x, y), force_n * (1 + 0.1 * u), rtol=1e-9)
    np.testing.assert_allclose(whole.slope(x, y)[0] - alone.slope(x, y)[0], 0.1 * force_n / 40.0, rtol=1e-6)
    np.testing.assert_allclose(whole.slope(x, y)[1], alone.slope(x, y)[1], atol=1e-9)


@pytest.mark.parametrize("family", [one for one in LOADED if one.name != "prism"], ids=lambda one: one.name)
def test_drawn_loads_are_steep_and_deep_up_to_the_limits(family):
    view, draw = View(small_rig()), np.random.default_rng(5)
    for turn in range(4):
        dent = pressed(family, view, draw, turn, 4.0, inf)
        assert all(load.width_mm >= 0.6 * family.widths_mm[0] for load in dent.loads)
        low, high = view.seen.min(axis=0) - MARGIN_MM, view.seen.max(axis=0) + MARGIN_MM
        x, y = np.meshgrid(*(np.linspace(*ends, 300) for ends in zip(low, high, strict=True)))
        steepest = np.hypot(*dent.slope(x, y)).max()
        # the limit is found on a lattice of a quarter of the narrowest width
        assert steepest <= 1.05 * MOST_SLOPE
        assert dent.depth(x, y).max() <= 0.3 * (1 + 1e-3)
        assert steepest > exp(-9) * MOST_SLOPE
