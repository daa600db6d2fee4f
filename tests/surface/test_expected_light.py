"""The light predicted from a warp, against the reflectance that the rays of a planted dent have."""

import numpy as np
import pytest
from surface_bench import Gauss

from zeromethod.optics import Dented, Optics
from zeromethod.rig.load import load_rig
from zeromethod.surface.expected_light import ExpectedLight
from zeromethod.warp.rest import Rest

DENT = Gauss(0.2, 44.0, 3.0, 5.0)
"""Slopes of 24 mrad."""


@pytest.fixture(scope="module")
def optics():
    return Optics(load_rig("paper"))


@pytest.fixture(scope="module")
def rest(optics):
    return Rest.of(optics.rig, optics)


@pytest.fixture(scope="module")
def expected(optics, rest):
    return ExpectedLight(optics, rest)


def pressed_q(optics, rest):
    q = optics.trace(*rest.grid.mesh(), Dented(optics.rest, DENT)).q
    return np.where(np.isfinite(q), q, rest.q)


def true_share(optics):
    v, u = np.indices((optics.rig.camera.rows, optics.rig.camera.columns)).astype(float)
    pressed = optics.trace(u, v, Dented(optics.rest, DENT)).reflectance
    return pressed / optics.trace(u, v, optics.rest).reflectance


def test_at_rest_every_pixel_sees_its_light(expected, rest):
    # float32
    np.testing.assert_allclose(expected.share(rest.q), 1.0, atol=1e-4)


def test_a_press_dims_one_flank_and_brightens_the_other_as_its_rays_say(optics, rest, expected):
    q, truth = pressed_q(optics, rest), true_share(optics)
    # a sudden press of this depth: the light of its first frame is right within 0.05, then the depth settles
    assert np.nanmax(np.abs(expected.share(q) - truth)) < 0.06
    expected.share(q)
    share = expected.share(q)
    known = np.isfinite(truth)
    assert np.nanmin(truth) < 0.56
    assert np.nanmax(truth) == pytest.approx(1 / 0.7334, abs=1e-3)
    error = np.abs(share - truth)[known]
    # A depth that is off by 2 um moves a slope by 0.05 mrad, and the share by 0.002; reflectance climbs to 1
    # with infinite slope, where the interpolant's h^3 counts for more.
    assert np.sqrt(np.mean(error**2)) < 0.003
    assert error.max() < 0.05


def test_the_light_follows_depth_too(optics, rest):
    """Depth left at 0 puts the kink of the light 5 mrad off: a fifth of the light over several px."""
    shallow, truth = ExpectedLight(optics, rest), true_share(optics)
    shallow._integrator.integrate = lambda slope, *_: np.zeros(slope.shape[:-1])  # type: ignore[method-assign]
    error = np.abs(shallow.share(pressed_q(optics, rest)) - truth)
    assert np.nanmax(error) > 0.2


def test_a_rig_beyond_the_critical_angle_needs_none_of_this():
    optics = Optics(load_rig("simulated"))
    assert not ExpectedLight(optics, Rest.of(optics.rig, optics)).needed


def test_a_warp_that_makes_no_sense_leaves_the_next_ones_alone(optics, rest):
    light = ExpectedLight(optics, rest)
    wild = rest.q + np.random.default_rng(3).normal(0, 300, rest.q.shape)
    assert np.isfinite(light.share(wild)).all()
    for _ in range(8):
        share = light.share(rest.q)
    # the depth of the last pass but one may still be off by 2 um
    np.testing.assert_allclose(share, 1.0, atol=0.005)
