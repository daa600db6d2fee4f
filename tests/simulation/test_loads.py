"""Loads on rubber: closed forms, quadrature of formulas not the simulator's, force and depth, paths."""

import numpy as np
import pytest
from scipy.integrate import quad, quad_vec
from scipy.special import ive, j0, j1

from zeromethod.errors import InputError
from zeromethod.mechanics.layer import wave_share
from zeromethod.rig.tables import FaceSupports, Rubber
from zeromethod.simulation.load_path import LoadPath, Pressed, dents_of
from zeromethod.simulation.loads import Form, Load, load, ring, rod, rough
from zeromethod.simulation.path import PathPoint
from zeromethod.simulation.press import Mirror
from zeromethod.simulation.scenario import Scenario, load_scenario

RUBBER = Rubber(youngs_modulus_mpa=0.4, poisson=0.48, support="free")
MODULUS = 0.4 / (1 - 0.48**2)
LAYER = Rubber(youngs_modulus_mpa=0.4, poisson=0.48, support="bonded", thickness_mm=7.0)


def half_space(r: np.ndarray, width_mm: float) -> np.ndarray:
    """Depth under a force that makes it 1 in the middle."""
    u = r**2 / (4 * width_mm**2)
    return np.asarray(ive(0, u))


@pytest.mark.parametrize("width_mm", [0.35, 3.54, 12.0])
def test_a_load_on_a_half_space_is_its_closed_form_near_and_far(width_mm):
    mirror = Mirror((load(42.0, 1.0, 0.2, width_mm),))
    r = np.concatenate((np.linspace(0.0, 6 * width_mm, 500), np.geomspace(width_mm, 150.0, 300)))
    u = r**2 / (4 * width_mm**2)
    # cubic splines leave 4e-9 of what changes over 1/64 of the load
    np.testing.assert_allclose(mirror.depth(42.0 + r, 1.0), 0.2 * half_space(r, width_mm), rtol=1e-6)
    by_x, by_y = mirror.slope(42.0 + 0.6 * r, 1.0 + 0.8 * r)
    slope = 0.2 * (ive(1, u) - ive(0, u)) * r / (2 * width_mm**2)
    np.testing.assert_allclose(by_x, 0.6 * slope, rtol=1e-5)
    np.testing.assert_allclose(by_y, 0.8 * slope, rtol=1e-5)


@pytest.mark.parametrize("bonded", [True, False])
@pytest.mark.parametrize(("width_mm", "thickness_mm"), [(3.54, 7.0), (0.5, 7.0), (3.54, 30.0), (6.0, 2.0)])
def test_a_load_on_a_layer_is_the_readers_layer_by_quadrature(bonded, width_mm, thickness_mm):
    support = "bonded" if bonded else "sliding"
    rubber = Rubber(support=support, thickness_mm=thickness_mm, poisson=0.48)
    mirror = Mirror((load(42.0, 0.0, 1.0, width_mm, rubber),))
    at, weight = np.polynomial.legendre.leggauss(400)
    waves = 4.0 * (at + 1) / width_mm  # exp(-32) of the load's beyond
    weight = (
        weight
        * wave_share(waves * thickness_mm, 0.48, bonded=bonded)
        * np.exp(-((waves * width_mm) ** 2) / 2)
    )
    whole = weight.sum()
    for r in np.array([0.3, 1.0, 2.0, 4.0]) * width_mm:
        assert mirror.depth(42.0 + r, 0.0) == pytest.approx((weight * j0(waves * r)).sum() / whole, abs=1e-6)
        slope = -(weight * waves * j1(waves * r)).sum() / whole
        assert mirror.slope(42.0, r)[1] == pytest.approx(slope, abs=1e-6 / width_mm)


def test_a_thick_layer_is_a_half_space_near_the_load():
    thick = Rubber(support="sliding", thickness_mm=3000.0)
    x = np.linspace(-10.0, 10.0, 21)
    np.testing.assert_allclose(
        Mirror((load(0.0, 0.0, 1.0, 2.0, thick),)).depth(x, 0.0), half_space(x, 2.0), atol=1e-3
    )


@pytest.mark.parametrize(("radius_mm", "width_mm"), [(1.0, 1.5), (6.0, 1.5), (6.0, 0.5)])
def test_a_ring_is_the_mean_of_loads_round_a_circle(radius_mm, width_mm):
    def mean(r):
        away = lambda a: np.sqrt(r**2 + radius_mm**2 - 2 * r * radius_mm * np.cos(a))  # noqa: E731
        return quad(lambda a: half_space(away(a), width_mm), 0.0, np.pi, limit=200)[0] / np.pi

    mirror = Mirror((ring(0.0, 0.0, 0.1, radius_mm, width_mm),))
    r = np.array([0.0, 0.4, 0.9, 1.0, 1.2, 3.0, 10.0]) * radius_mm
    found = mirror.depth(0.6 * r, -0.8 * r)
    exact = np.array([mean(each) for each in r])
    np.testing.assert_allclose(found / found[0], exact / exact[0], rtol=1e-6)
    dense = mirror.depth(np.linspace(0.0, 2 * radius_mm, 4001), 0.0)
    assert dense.max() == pytest.approx(0.1, rel=1e-4)  # the deepest point is found to 1/64 of a width


@pytest.mark.parametrize(("length_mm", "width_mm"), [(2.0, 1.5), (12.0, 1.5), (8.0, 0.5)])
def test_a_rod_is_the_mean_of_loads_along_its_line(length_mm, width_mm):
    mirror = Mirror((rod(42.0, 1.0, 0.1, length_mm, width_mm, 30.0),))
    draw, c, s = np.random.default_rng(1), np.cos(np.radians(30.0)), np.sin(np.radians(30.0))
    along, across = draw.uniform(-1, 1, (2, 40)) * np.concatenate((np.full(20, length_mm), np.full(20, 60.0)))
    half = length_mm / 2
    ends = {"points": np.linspace(-half, half, 40), "epsabs": 1e-10}
    exact = quad_vec(lambda t: half_space(np.hypot(along - t, across), width_mm), -half, half, **ends)[0]
    middle = quad(lambda t: half_space(np.array(t), width_mm), -half, half)[0]
    found = mirror.depth(42.0 + c * along - s * across, 1.0 + s * along + c * across)
    # maps have a pitch of 1/8 of a width near the loads and of the distance far away: 1e-5, 1e-3 of it
    np.testing.assert_allclose(found, 0.1 * exact / middle, rtol=1e-3, atol=3e-6)
    assert mirror.depth(42.0, 1.0) == pytest.approx(0.1, rel=1e-4)


def test_what_is_rough_is_a_sum_of_loads_as_deep_as_it_says_and_differs_by_seed():
    mirror, other = (Mirror((rough(40.0, 0.0, 0.1, 8.0, 2.0, seed),)) for seed in (3, 4))
    pieces = Load(Form.ROUGH, 2.0, 8.0, seed=3).unit(RUBBER).pieces
    assert len(pieces.x) == 16
    assert np.hypot(pieces.x, pieces.y).max() < 4.0  # widths
    x, y = (each.ravel() for each in np.meshgrid(np.linspace(28, 52, 97), np.linspace(-12, 12, 97)))
    exact = sum(
        share * half_space(np.hypot(x - 40.0 - 2 * a, y - 2 * b), 2.0)
        for a, b, share in zip(pieces.x, pieces.y, pieces.share, strict=True)
    )
    found = mirror.depth(x, y)
    assert found.max() == pytest.approx(0.1, rel=5e-3)  # of a lattice of 0.25 mm
    np.testing.assert_allclose(found, exact * found[0] / exact[0], atol=3e-5)
    assert np.abs(found - other.depth(x, y)).max() > 0.01


@pytest.mark.parametrize(
    "one",
    [
        Load(Form.LOAD, 2.0), Load(Form.RING, 1.0, 5.0), Load(Form.ROD, 1.0, length_mm=8.0, angle_deg=40.0),
        Load(Form.ROUGH, 1.5, 6.0, seed=2),
    ],
    ids=lambda one: one.form,
)  # fmt: skip
def test_force_and_depth_are_of_one_dent(one):
    by_force = dents_of([Pressed(one, 40.0, 2.0, force_n=0.3)], RUBBER)
    depth_mm = by_force[0].depth_mm
    assert dents_of([Pressed(one, 40.0, 2.0, depth_mm=depth_mm)], RUBBER)[0].depth_mm == pytest.approx(
        depth_mm
    )
    # seen from afar, all round: depth x distance = F / (pi E*), but for (size / 80 mm)^2
    turn = np.linspace(0, 2 * np.pi, 24, endpoint=False)
    far = Mirror(by_force).depth(40.0 + 80 * np.cos(turn), 2.0 + 80 * np.sin(turn)).mean()
    assert far * 80 * np.pi * MODULUS == pytest.approx(0.3, rel=5e-3)
    if one.form is Form.LOAD:
        assert depth_mm == pytest.approx(0.3 / (np.sqrt(2 / np.pi) * 2.0 * np.pi * MODULUS), rel=1e-6)


def test_on_a_layer_a_force_presses_less_deep_than_into_a_half_space():
    deep, shallow = (
        dents_of([Pressed(Load(Form.LOAD, 3.0), 0.0, 0.0, force_n=0.1)], rubber)[0].depth_mm
        for rubber in (RUBBER, LAYER)
    )
    # Hankel integral of the reader's layer, as above
    share = quad(
        lambda k: wave_share(np.array([k * 7.0]), 0.48, bonded=True)[0] * np.exp(-4.5 * k**2), 1e-6, 3.0
    )
    assert shallow / deep == pytest.approx(share[0] / (np.sqrt(np.pi / 2) / 3.0), rel=1e-5)


def test_a_load_that_slides_takes_the_same_dent_along():
    points = (PathPoint(0, 30.0, 0.0, 0.1), PathPoint(1000, 50.0, 4.0, 0.1))
    scenario = Scenario(
        "slide", (), 1e-6, rubber=LAYER, loads=(LoadPath(Load(Form.ROD, 1.5, length_mm=9.0), points),)
    )
    assert scenario.moving(0, 1000)
    assert scenario.bends_ns(-1, 2000) == (0, 1000)
    start, later = (scenario.mirror_at(time).dents for time in (0, 500))
    assert start[0].map is later[0].map
    x, y = np.random.default_rng(2).uniform(-15, 15, (2, 60))
    here, there = Mirror(start).depth(30.0 + x, y), Mirror(later).depth(40.0 + x, 2.0 + y)
    np.testing.assert_allclose(here, there, atol=1e-15)


def test_it_couples_light_out_inside_its_contact():
    at = {"depth_mm": 0.1}
    pad, bar = Load(Form.LOAD, 2.0, contact_mm=1.0), Load(Form.ROD, 1.0, length_mm=8.0, contact_mm=0.5)
    pad_mirror, bar_mirror = (Mirror(dents_of([Pressed(one, 0.0, 0.0, **at)], RUBBER)) for one in (pad, bar))
    np.testing.assert_array_equal(pad_mirror.reflectance_factor([0.0, 0.9, 1.1], 0.0), [0.05, 0.05, 1.0])
    np.testing.assert_array_equal(
        bar_mirror.reflectance_factor([3.9, 4.1, 0.0], [0.0, 0.0, 0.6]), [0.05, 1.0, 1.0]
    )


def test_a_load_alone_knows_no_prism():
    with pytest.raises(InputError, match="half-space or a layer"):
        load(42.0, 0.0, 0.2, 3.5, Rubber(support=FaceSupports()))


PRESS = "[[press]]\npath = [{ time_s = 0.0, x_mm = 1.0, y_mm = 2.0, AMOUNT }]\n"
DEPTH = PRESS.replace("AMOUNT", "depth_mm = 0.3")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (DEPTH + "shape = 'load'", "press[0].width_mm: missing: needed for shape 'load'"),
        (DEPTH + "shape = 'load'\nwidth_mm = 0.01", "press[0].width_mm: 0.01: a number at least 0.1"),
        (
            DEPTH + "shape = 'load'\nwidth_mm = 2\nsigma_mm = 1",
            "press[0].sigma_mm: 1.0: not for shape 'load'",
        ),
        (
            DEPTH + "shape = 'load'\nwidth_mm = 2\nlength_mm = 1",
            "press[0].length_mm: 1.0: not for shape 'load'",
        ),
        (DEPTH + "shape = 'ring'\nwidth_mm = 2", "press[0].radius_mm: missing: needed for shape 'ring'"),
        (
            DEPTH + "shape = 'rod'\nwidth_mm = 0.2\nlength_mm = 9",
            "press[0].length_mm: 9.0: at most 25 x width_mm = 5",
        ),
        (DEPTH + "shape = 'rough'\nwidth_mm = 2\nradius_mm = 6", "press[0].seed: missing: needed for shape"),
        (
            DEPTH + "shape = 'rough'\nwidth_mm = 2\nradius_mm = 6\nseed = -1",
            "press[0].seed: -1: a whole number at least 0",
        ),
        (
            PRESS.replace("AMOUNT", "depth_mm = 0.1, force_n = 1") + "shape = 'load'\nwidth_mm = 2",
            "press[0].path: missing: depth_mm at every point, or force_n at every point",
        ),
        (
            PRESS.replace("AMOUNT", "force_n = 1") + "shape = 'gaussian'\nsigma_mm = 2",
            "press[0].path: missing: depth_mm at every point for shape 'gaussian', and no force_n",
        ),
    ],
)
def test_bad_loads_are_refused_in_one_line(refusal, text, message):
    assert refusal(text).startswith(message)


def test_a_press_file_presses_loads_by_force_on_the_rigs_rubber(tmp_path):
    file = tmp_path / "mine.toml"
    path = "path = [{ time_s = 0.0, x_mm = 1.0, y_mm = 2.0, force_n = 0.3 }]\n"
    file.write_text(f"[[press]]\nshape = 'load'\nwidth_mm = 2.0\ncontact_mm = 0.5\n{path}")
    found = load_scenario(file, RUBBER).mirror_at(0)
    exact = 0.3 / (np.sqrt(2 / np.pi) * 2.0 * np.pi * MODULUS)
    assert found.depth(1.0, 2.0) == pytest.approx(exact, rel=1e-6)
    assert found.reflectance_factor(1.4, 2.0) == 0.05
    on_layer = load_scenario(file, LAYER).mirror_at(0)
    assert on_layer.depth(1.0, 2.0) < 0.7 * exact
