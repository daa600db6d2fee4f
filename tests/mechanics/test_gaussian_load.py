"""Dents of Gaussian pressures: closed forms, the simulator's own layer, and what a prism adds."""

import numpy as np
import pytest
from scipy.special import ive

from zeromethod.mechanics.body import BodyKernel, body_of
from zeromethod.mechanics.gaussian_load import HalfSpace, LayerBody, Loads, PrismBody
from zeromethod.rig.load import load_rig
from zeromethod.rig.tables import Rubber
from zeromethod.simulation.load_path import Pressed, dents_of
from zeromethod.simulation.loads import Form, Load, load
from zeromethod.simulation.press import Mirror

LOADS = Loads(np.array([42.0, 30.0, 55.0]), np.array([0.0, 7.0, -4.0]), np.array([2.0, 5.0, 9.0]))
X, Y = (each.ravel() for each in np.meshgrid(np.linspace(10.0, 75.0, 27), np.linspace(-20.0, 20.0, 17)))


def differences(body, loads, x, y, step=0.05):
    """Slopes along x and y by central differences of depth."""
    return [
        (body.at(x + dx, y + dy)(loads)[0] - body.at(x - dx, y - dy)(loads)[0]) / (2 * step)
        for dx, dy in ((step, 0.0), (0.0, step))
    ]


def kernel():
    """One that no body has: smooth, and lopsided."""
    draw = np.random.default_rng(2)
    fade = np.exp(-np.add.outer(np.arange(5.0), np.arange(6.0)))
    return BodyKernel(
        70.0, 25.0, 0.05 * fade * draw.standard_normal((3, 5, 6)), fade * draw.standard_normal((3, 5, 6))
    )


def test_a_half_spaces_dents_are_the_closed_form():
    depth, along, across = HalfSpace().at(X, Y)(LOADS)
    dx, dy = X[:, None] - LOADS.x_mm, Y[:, None] - LOADS.y_mm
    u = (dx**2 + dy**2) / (4 * LOADS.width_mm**2)
    # tables of 0.02 widths, between which the middle bends by 0.02^2 / 8 x 1/2
    np.testing.assert_allclose(depth, ive(0, u), atol=3e-5)
    by_r = (ive(1, u) - ive(0, u)) / (2 * LOADS.width_mm**2)
    for found, way in ((along, dx), (across, dy)):
        np.testing.assert_allclose(found * LOADS.width_mm, by_r * way * LOADS.width_mm, atol=3e-5)


@pytest.mark.parametrize(
    "body",
    [HalfSpace(), LayerBody(9.0, 0.48, True), LayerBody(9.0, 0.48, False), PrismBody(kernel())],
    ids=["half-space", "bonded", "sliding", "prism"],
)
def test_slopes_are_those_of_the_depths(body):
    inside = (X > 1.0) & (X < 69.0)
    x, y = X[inside] + 0.01, Y[inside] + 0.02
    found = body.at(x, y)(LOADS)[1:]
    # depths in single precision over 0.1 mm: 1e-6; tables of 0.02 widths bend the differences by 2 %
    # of what their steps bend: 0.01 x 1/2 of slope per width
    for by, exact in zip(found, differences(body, LOADS, x, y), strict=True):
        np.testing.assert_allclose(by * LOADS.width_mm, exact * LOADS.width_mm, atol=5e-3)


def test_far_away_a_dent_is_q_over_the_distance():
    distance = np.array([20.0, 40.0, 80.0])
    depth, along, _ = HalfSpace().at(distance, np.zeros(3))(Loads(*np.array([[0.0], [0.0], [1.5]])))
    q = 1.5 * np.sqrt(2 / np.pi)
    assert LOADS.q_mm2 / LOADS.width_mm == pytest.approx(q / 1.5)
    # the next term is l^2 / 2 r^2 of it, in slope 3 l^2 / 2 r^2
    more = (1.5 / distance) ** 2
    np.testing.assert_allclose(depth[:, 0], q / distance * (1 + more / 2), rtol=2e-4)
    np.testing.assert_allclose(along[:, 0], -q / distance**2 * (1 + 1.5 * more), rtol=2e-4)


@pytest.mark.parametrize("support", ["bonded", "sliding"])
@pytest.mark.parametrize(
    ("width_mm", "thickness_mm"), [(2.0, 7.0), (3.5, 7.0), (0.8, 30.0), (8.0, 30.0), (6.0, 3.0)]
)
def test_a_layers_dents_are_the_simulators(support, width_mm, thickness_mm):
    rubber = Rubber(support=support, thickness_mm=thickness_mm, poisson=0.48)
    exact = Mirror((load(40.0, 0.0, 1.0, width_mm, rubber),))
    body = LayerBody(thickness_mm, 0.48, support == "bonded")
    r = np.concatenate((np.linspace(0.0, 5 * width_mm, 40), np.linspace(1.0, 11.0, 20) * thickness_mm))
    depth, along, across = body.at(40.0 + 0.6 * r, 0.8 * r)(
        Loads(np.array([40.0]), np.array([0.0]), np.array([width_mm]))
    )[..., 0]
    # what the base takes from the middle is of the reader alone: its dents count from the half-space's
    np.testing.assert_allclose(depth / depth[0], exact.depth(40.0 + 0.6 * r, 0.8 * r), atol=1e-3)
    for by, also in zip((along, across), exact.slope(40.0 + 0.6 * r, 0.8 * r), strict=True):
        np.testing.assert_allclose(by / depth[0], also, atol=1e-3 / width_mm)


def test_a_base_takes_from_the_middle_what_it_takes_from_the_simulators_load_of_the_same_force():
    thick, thin = (
        dents_of([Pressed(Load(Form.LOAD, 3.0), 0.0, 0.0, force_n=0.3)], rubber)[0].depth_mm
        for rubber in (
            Rubber(youngs_modulus_mpa=0.4, poisson=0.48, support="free"),
            Rubber(youngs_modulus_mpa=0.4, poisson=0.48, support="bonded", thickness_mm=7.0),
        )
    )
    zero = np.zeros(1)
    found = LayerBody(7.0, 0.48, True).at(zero, zero)(Loads(zero, zero, np.full(1, 3.0)))[0, 0, 0]
    assert found == pytest.approx(thin / thick, rel=1e-3)


def test_far_beyond_its_thickness_a_layer_is_at_rest():
    distance = np.array([59.0, 61.0, 200.0])
    for bonded in (True, False):
        fields = LayerBody(5.0, 0.48, bonded).at(distance, np.zeros(3))(
            Loads(*np.array([[0.0], [0.0], [2.0]]))
        )
        # a half-space is 27 um deep there for each mm: a thousandth of that where the table ends
        np.testing.assert_allclose(fields, 0.0, atol=1e-5)


def test_a_prism_adds_its_kernel_averaged_over_the_pressure():
    body, dense = kernel(), np.polynomial.hermite_e.hermegauss(9)
    x, y = X[X < 70.0], Y[X < 70.0]
    found = PrismBody(body, 1.2).at(x, y)(LOADS) - HalfSpace().at(x, y)(LOADS)
    share = np.outer(dense[1], dense[1]).ravel() / dense[1].sum() ** 2
    for k in range(len(LOADS)):
        places = np.stack(
            [
                one.ravel()
                for one in np.meshgrid(
                    LOADS.x_mm[k] + LOADS.width_mm[k] * dense[0],
                    LOADS.y_mm[k] + LOADS.width_mm[k] * dense[0],
                )
            ]
        )
        exact = 1.2 * LOADS.q_mm2[k] * body.added(np.stack([x, y]), places) @ share
        # three points are exact to the fifth degree; single precision
        tolerance = 1e-6 if k == 0 else 5e-3
        np.testing.assert_allclose(found[0, :, k], exact, atol=tolerance * np.abs(exact).max() + 1e-6)


def test_two_loads_on_the_rigs_prism_do_to_each_other_the_same():
    """Betti's reciprocity: pressure of one times depth of the other, for the same force."""
    body = body_of(load_rig("simulated").replace({"rubber.support": {"pattern": "bonded", "ends": "bonded"}}))
    assert body is not None
    loads = Loads(np.array([30.0, 52.0]), np.array([-6.0, 9.0]), np.array([3.0, 3.0]))
    whole, free = (one.at(loads.x_mm, loads.y_mm)(loads)[0] for one in (PrismBody(body), HalfSpace()))
    added = whole.astype(np.float64) - free
    # as the kernel's: a hundredth of its largest
    assert added[0, 1] == pytest.approx(added[1, 0], abs=0.01 * np.abs(added).max())
    assert abs(added[0, 1]) > 0.1 * np.abs(added).max()
