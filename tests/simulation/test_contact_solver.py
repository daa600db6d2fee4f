"""Elastic contact against closed forms: Hertz, Sneddon, Boussinesq, JKR, layers by an integral equation."""

import numpy as np
import pytest

from zeromethod import InputError
from zeromethod.optics import Cylinder
from zeromethod.rig.prism_tables import RestSurface
from zeromethod.rig.tables import Rubber
from zeromethod.simulation.contact.adhesion import BallContact
from zeromethod.simulation.contact.bow import bow_of, on_rest
from zeromethod.simulation.contact.compliance import Compliance, LatticeResponse, layer_factor
from zeromethod.simulation.contact.objects import Form, Held, Solid
from zeromethod.simulation.contact.patch import Lattice, Patch, Presser
from zeromethod.simulation.contact.path import ObjectPath
from zeromethod.simulation.contact.scene import scene_of
from zeromethod.simulation.contact.solver import press_to_depth
from zeromethod.simulation.path import PathPoint

RUBBER = Rubber(youngs_modulus_mpa=1.7, poisson=0.47)
MODULUS = 1.7 / (1 - 0.47**2)
LAYERS = [
    Rubber(support="bonded", thickness_mm=2.0, poisson=0.5),
    Rubber(support="sliding", thickness_mm=1.0, poisson=0.45),
]


def solved(held: Held, rubber: Rubber = RUBBER):
    (touch,) = scene_of([held], rubber).touches
    return touch


def test_a_balls_force_and_area_are_hertz_s():
    a, radius = 0.5, 5.0
    touch = solved(Held(Solid(Form.BALL, radius), 42.0, 1.0, depth_mm=a * a / radius))
    assert touch.force_n == pytest.approx(4 / 3 * MODULUS * a**3 / radius, rel=1e-3)
    assert touch.area_mm2 == pytest.approx(np.pi * a * a, rel=1e-3)
    assert touch.centroid_mm == pytest.approx((42.0, 1.0), abs=1e-3)


def test_on_a_dome_a_balls_curvature_adds_to_the_mirrors():
    """Hertz with 1 / R = 1 / 20 + 1 / 30; a flat plate on a dome touches as a ball of its radius does."""
    dome, depth = RestSurface(shape="sphere", radius_mm=30.0, centre_mm=(40.0, 0.0)), 0.05
    for solid, radius in ((Solid(Form.BALL, 20.0), 12.0), (Solid(Form.PUNCH, 15.0), 30.0)):
        touch = solved(on_rest(Held(solid, 42.0, 1.0, depth_mm=depth), dome))
        assert touch.area_mm2 == pytest.approx(np.pi * radius * depth, rel=2e-3)
        assert touch.force_n == pytest.approx(4 / 3 * MODULUS * np.sqrt(radius * depth**3), rel=1e-3)


def test_a_plate_touches_a_cylinder_along_its_axis(tmp_path):
    cylinder = RestSurface(shape="cylinder", radius_mm=40.0, centre_mm=(40.0, 0.0), axis_deg=30.0)
    touch = solved(on_rest(Held(Solid(Form.PUNCH, 4.0), 40.0, 0.0, depth_mm=0.01), cylinder))
    away = np.linspace(-3.9, 3.9, 400)
    c, s = np.cos(np.radians(30.0)), np.sin(np.radians(30.0))
    assert touch.covers(40.0 + c * away, s * away).all()
    assert touch.covers(40.0 - s * away, c * away).mean() < 0.4
    # the same from a map of its heights
    x, y = np.meshgrid(np.arange(20.0, 61.0), np.arange(-20.0, 21.0))
    np.save(tmp_path / "rest.npy", Cylinder(40.0, (40.0, 0.0), 30.0).height(x, y))
    heights = RestSurface(shape="map", file=tmp_path / "rest.npy", pitch_mm=1.0, origin_mm=(20.0, -20.0))
    assert bow_of(heights, 40.0, 0.0) == pytest.approx(bow_of(cylinder, 40.0, 0.0), rel=2e-3)


def test_a_ball_that_sticks_is_refused_on_a_curved_mirror():
    sticking = Held(Solid(Form.BALL, 5.0, adhesion_j_m2=0.05), 42.0, 0.0, depth_mm=0.02)
    with pytest.raises(InputError, match=r"adhesion_j_m2: 0.05: 0 on a curved mirror"):
        on_rest(sticking, RestSurface(shape="sphere", radius_mm=30.0))


def test_a_cones_force_and_area_are_sneddon_s():
    steepness, depth = np.tan(np.radians(20.0)), 0.1
    touch = solved(Held(Solid(Form.CONE, flank_deg=20.0), 40.0, -2.0, depth_mm=depth))
    assert touch.force_n == pytest.approx(2 * MODULUS * depth**2 / (np.pi * steepness), rel=1e-3)
    assert touch.area_mm2 == pytest.approx(np.pi * (2 * depth / (np.pi * steepness)) ** 2, rel=1e-3)


def test_a_punchs_force_is_boussinesq_s():
    touch = solved(Held(Solid(Form.PUNCH, 1.5), 42.0, 0.0, depth_mm=0.03))
    # its pressure runs to infinity at the edge, which cells of a hundredth of the radius follow to 0.2 %
    assert touch.force_n == pytest.approx(2 * MODULUS * 1.5 * 0.03, rel=3e-3)
    assert touch.area_mm2 == pytest.approx(np.pi * 1.5**2, rel=1e-3)


def test_a_long_rods_width_is_that_of_a_line_contact():
    touch = solved(Held(Solid(Form.EDGE, 4.0, length_mm=20.0, angle_deg=30.0), 42.0, 0.0, force_n=1.0))
    half = np.sqrt(4 * (1.0 / 20.0) * 4.0 / (np.pi * MODULUS))
    # force gathers at the ends of a rod: 4 to 5 % of its middle's is there for this length over width
    across = np.linspace(-1.0, 1.0, 4001)
    angle = np.radians(30.0)
    width = touch.covers(42.0 - across * np.sin(angle), across * np.cos(angle)).mean()
    assert width == pytest.approx(half, rel=0.05)


def test_force_and_depth_give_the_same_contact():
    solid = Solid(Form.CONE, flank_deg=10.0)
    by_depth = solved(Held(solid, 0.0, 0.0, depth_mm=0.05))
    by_force = solved(Held(solid, 0.0, 0.0, force_n=by_depth.force_n))
    assert by_force.force_n == pytest.approx(by_depth.force_n, rel=1e-9)
    assert by_force.area_mm2 == pytest.approx(by_depth.area_mm2, rel=1e-3)


@pytest.mark.parametrize(
    "solid",
    [
        Solid(Form.BALL, 5.0),
        Solid(Form.FINGER, 8.0, ridge_pitch_mm=0.45, ridge_height_mm=0.02),
        Solid(Form.CONE, flank_deg=20.0),
    ],
    ids=lambda solid: solid.form,
)
def test_double_resolution_changes_forces_by_less_than_three_per_mille(solid, monkeypatch):
    held = Held(solid, 0.0, 0.0, depth_mm=0.08)
    force = [Presser(held, Compliance(RUBBER)).patch([]).force_n]
    monkeypatch.setattr("zeromethod.simulation.contact.patch.CELLS", 384**2)
    force.append(Presser(held, Compliance(RUBBER)).patch([]).force_n)
    assert force[0] == pytest.approx(force[1], rel=3e-3)


@pytest.mark.parametrize("rubber", LAYERS, ids=lambda rubber: rubber.support)
def test_a_ball_on_a_layer_agrees_with_the_integral_equation(rubber):
    contact_mm = 0.8
    exact = BallContact(rubber, 5.0).within(contact_mm)
    touch = solved(Held(Solid(Form.BALL, 5.0), 0.0, 0.0, depth_mm=exact.depth_mm), rubber)
    assert touch.force_n == pytest.approx(exact.force_n, rel=1e-3)
    assert touch.area_mm2 == pytest.approx(np.pi * contact_mm**2, rel=2e-3)


@pytest.mark.parametrize("rubber", LAYERS, ids=lambda rubber: rubber.support)
def test_a_thick_layer_is_a_half_space_and_a_thin_one_stiffer(rubber):
    def force(thickness_mm: float) -> float:
        layer = rubber.model_copy(update={"thickness_mm": thickness_mm})
        return BallContact(layer, 5.0).within(0.5).force_n

    free = BallContact(Rubber(poisson=rubber.poisson), 5.0).within(0.5).force_n
    assert force(500.0) == pytest.approx(free, rel=1e-2)
    assert force(500.0) < force(2.0) < force(1.0)


@pytest.mark.parametrize(
    ("poisson", "bonded", "limit"),
    [(0.3, True, 0.4 / (2 * 0.7**2)), (0.5, True, 0.0), (0.3, False, 0.5), (0.5, False, 0.5)],
)
def test_layers_are_compressed_evenly_by_long_waves_and_as_a_half_space_by_short_ones(poisson, bonded, limit):
    low = 1e-3
    assert layer_factor(np.array([low]), poisson, bonded=bonded)[0] / low == pytest.approx(limit, abs=2e-3)
    assert layer_factor(np.array([20.0]), poisson, bonded=bonded)[0] == pytest.approx(1.0, abs=1e-12)


def test_a_sticking_ball_obeys_jkr():
    work, radius, depth = 0.05, 5.0, 0.02
    touch = solved(Held(Solid(Form.BALL, radius, adhesion_j_m2=work), 0.0, 0.0, depth_mm=depth))
    a = np.sqrt(touch.area_mm2 / np.pi)
    assert a**2 / radius - np.sqrt(2 * np.pi * a * 1e-3 * work / MODULUS) == pytest.approx(depth, rel=2e-3)
    force = 4 / 3 * MODULUS * a**3 / radius - np.sqrt(8 * np.pi * a**3 * 1e-3 * work * MODULUS)
    # cells at the edge, where the tension runs to infinity
    assert touch.force_n == pytest.approx(force, rel=5e-3)
    assert touch.area_mm2 > 1.2 * solved(Held(Solid(Form.BALL, radius), 0.0, 0.0, depth_mm=depth)).area_mm2


def test_a_ball_that_sticks_is_pulled_as_far_as_jkr_lets_it():
    """It parts at 3/2 pi w R = 1.18 mN; doi:10.1098/rspa.1971.0141."""
    sticks = Solid(Form.BALL, 5.0, adhesion_j_m2=0.05)
    touch = solved(Held(sticks, 0.0, 0.0, force_n=-0.001))
    a = np.sqrt(touch.area_mm2 / np.pi)
    force = 4 / 3 * MODULUS * a**3 / 5.0 - np.sqrt(8 * np.pi * a**3 * 0.05e-3 * MODULUS)
    assert force == pytest.approx(-0.001, rel=0.01)
    with pytest.raises(InputError, match="it parts ball and rubber"):
        solved(Held(sticks, 0.0, 0.0, force_n=-0.0012))
    path = ObjectPath(sticks, (PathPoint(0, 42.0, 0.0, -0.001),), by_force=True)
    assert path.held_at(0) is not None
    assert ObjectPath(Solid(Form.BALL, 5.0), path.points, by_force=True).held_at(0) is None


def test_displacement_far_from_a_load_is_boussinesq_s():
    spread = LatticeResponse(Compliance(RUBBER), (3, 3), 0.01, margin=400)
    pressure = np.zeros((3, 3))
    pressure[1, 1] = 1.0
    at = spread.displacement(pressure)[401, 401 + 300]
    # (pitch / distance)^2 / 24 from a point load
    assert at == pytest.approx(0.01**2 / (np.pi * MODULUS * 3.0), rel=1e-5)


def test_gap_is_closed_where_pressed_and_open_elsewhere():
    lattice = Lattice(64, 64, 0.02)
    along, across = lattice.mesh()
    spread = LatticeResponse(Compliance(RUBBER), (64, 64), 0.02)
    pressed = press_to_depth(spread, Solid(Form.BALL, 5.0).profile(along, across), 0.05, np.zeros((64, 64)))
    inside = pressed.pressure_mpa > 0
    assert np.abs(pressed.gap_mm[inside]).max() < 1e-5 * 0.05
    assert pressed.gap_mm[~inside].min() > -1e-5 * 0.05
    assert Patch(Held(Solid(Form.BALL, 5.0), 0, 0), lattice, pressed, inside).force_n > 0
