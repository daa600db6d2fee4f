"""The kernel of a rig's prism: between its points, under finer elements, scaled, kept in a file."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.special import ive

from zeromethod.errors import InputError
from zeromethod.kept_arrays import cache_folder
from zeromethod.rig.prism_tables import Prism
from zeromethod.rig.tables import FaceSupports, Rubber
from zeromethod.simulation.contact.objects import Form, Held, Solid
from zeromethod.simulation.contact.scene import scene_of
from zeromethod.simulation.elements import prism as module
from zeromethod.simulation.elements.correction import mirror_response
from zeromethod.simulation.elements.prism import HeldPrism, prism_kernel
from zeromethod.simulation.load_path import Pressed, dents_of
from zeromethod.simulation.loads import Form as LoadForm
from zeromethod.simulation.loads import Load
from zeromethod.simulation.press import Mirror

PRISM = Prism(
    pattern_angle_deg=50.0, camera_angle_deg=50.0, pattern_length_mm=60.0, width_mm=60.0, index=1.41
)
RUBBER = Rubber(support=FaceSupports())
COARSE = 0.5
BALL = Held(Solid(Form.BALL, 40.0), 42.0, 0.0, depth_mm=0.02)


def held(refined: float = COARSE, supports: FaceSupports = RUBBER.support, prism: Prism = PRISM) -> HeldPrism:
    return replace(HeldPrism.of(prism, supports, 0.49), refined=refined)


@pytest.fixture(scope="module")
def kernels():
    """By refinement, known at fewer points."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(module, "PLACES", (14, 12))
        patch.setattr(module, "FORCES", (12, 10))
        return {refined: held(refined).kernel() for refined in (COARSE, 0.75)}


def scene(kernel, monkeypatch, *objects: Held):
    monkeypatch.setattr("zeromethod.simulation.contact.compliance.prism_kernel", lambda _: kernel)
    found = scene_of(objects, RUBBER, PRISM)
    return found.touches, Mirror(found.dents, found.touches)


def test_between_its_points_the_kernel_is_the_bodys_response(kernels):
    draw = np.random.default_rng(3)
    places, forces = (draw.uniform([[18], [-21]], [[62], [21]], (2, n)) for n in (30, 6))
    exact = mirror_response(held().body, forces, places)
    np.testing.assert_allclose(
        kernels[COARSE].between(places, forces), exact, atol=0.01 * np.abs(exact).max()
    )
    depth = kernels[COARSE].of_forces(forces[0], forces[1], np.arange(6.0))
    np.testing.assert_allclose(
        np.diag(kernels[COARSE].on_grid(depth, places[0], places[1])),
        kernels[COARSE].between(places, forces) @ np.arange(6.0),
    )


@pytest.mark.parametrize(
    "objects",
    [
        (BALL,),
        (Held(Solid(Form.PUNCH, 6.0), 30.0, 8.0, depth_mm=0.05),),
        (BALL, Held(Solid(Form.CONE, flank_deg=20.0), 55.0, -6.0, force_n=0.2, number=1)),
    ],
    ids=["ball", "punch", "two"],
)
def test_finer_elements_change_scenes_by_less_than_three_per_mille(objects, kernels, monkeypatch):
    found = []
    for kernel in kernels.values():
        module.prism_kernel.cache_clear()
        scene_of.__globals__["_solved"].cache_clear()
        touches, mirror = scene(kernel, monkeypatch, *objects)
        x, y = np.meshgrid(np.linspace(20, 62, 15), np.linspace(-18, 18, 13))
        found.append((np.array([touch.force_n for touch in touches]), mirror.depth(x, y)))
    np.testing.assert_allclose(found[0][0], found[1][0], rtol=3e-3)
    np.testing.assert_allclose(found[0][1], found[1][1], atol=3e-3 * np.abs(found[1][1]).max())


def test_a_ball_is_hertz_s_on_a_surface_that_yields_less_as_a_whole(kernels, monkeypatch):
    ((touch,), mirror) = scene(kernels[COARSE], monkeypatch, BALL)
    at = np.array([[42.0], [0.0]])
    added = mirror_response(held().body, at, at + 1e-3)[0, 0]
    modulus = 1 / (1 - 0.49**2)
    a = (3 * touch.force_n * 40.0 / (4 * modulus)) ** (1 / 3)
    assert a**2 / 40.0 + added * touch.force_n == pytest.approx(0.02, rel=2e-3)
    assert added < 0
    far = mirror.depth(np.array([60.0]), np.array([0.0]))
    # held all around, rubber yields little 18 mm away: a half-space would by 0.42 um
    assert abs(far[0]) < 1e-4


def test_a_sticking_ball_pulls_on_the_body_too(kernels, monkeypatch):
    sticking = Held(Solid(Form.BALL, 5.0, adhesion_j_m2=0.05), 42.0, 0.0, depth_mm=0.02)
    ((touch,), mirror) = scene(kernels[COARSE], monkeypatch, sticking)
    assert mirror.depth(np.array([42.0]), np.array([0.0])) == pytest.approx([0.02], rel=1e-3)
    modulus, a = 1 / (1 - 0.49**2), np.sqrt(touch.area_mm2 / np.pi)
    force = 4 / 3 * modulus * a**3 / 5.0 - np.sqrt(8 * np.pi * a**3 * 5e-5 * modulus)
    assert touch.force_n == pytest.approx(force, rel=5e-3)


def test_a_prism_twice_as_large_adds_half_as_much(kernels):
    large = PRISM.model_copy(update={"pattern_length_mm": 120.0, "width_mm": 120.0})
    at = np.array([[42.0, 30.0], [0.0, 8.0]])
    exact = mirror_response(held(prism=large).body, 2 * at, 2 * at)
    np.testing.assert_allclose(kernels[COARSE].between(at, at), 2 * exact, atol=0.02 * np.abs(exact).max())


def test_a_kernel_is_kept_in_a_file_and_a_broken_file_is_made_again(monkeypatch):
    monkeypatch.setattr(module, "CELLS", 4)
    monkeypatch.setattr(module, "LINE_CELLS", 3)
    first = prism_kernel(held(1.0))
    (file,) = cache_folder().iterdir()
    prism_kernel.cache_clear()
    monkeypatch.setattr(HeldPrism, "kernel", lambda _: pytest.fail("worked out again"))
    np.testing.assert_array_equal(prism_kernel(held(1.0)).coefficients, first.coefficients)
    file.write_bytes(file.read_bytes()[:1000])
    prism_kernel.cache_clear()
    monkeypatch.setattr(HeldPrism, "kernel", lambda _: first)
    np.testing.assert_array_equal(prism_kernel(held(1.0)).coefficients, first.coefficients)
    prism_kernel.cache_clear()
    assert held(1.0).depends_on != held(1.0, FaceSupports(ends="bonded")).depends_on


def test_a_prism_that_nothing_holds_is_refused():
    with pytest.raises(InputError, match="nothing holds the prism"):
        FaceSupports(pattern="sliding", camera="free")
    with pytest.raises(InputError, match="thickness_mm"):
        Rubber(support=FaceSupports(), thickness_mm=3.0)
    with pytest.raises(InputError, match="per face only with the prism of a rig"):
        scene_of([BALL], RUBBER)


ROD = Load(LoadForm.ROD, 2.0, length_mm=14.0, angle_deg=30.0)
LOADS = (Pressed(Load(LoadForm.LOAD, 3.54), 42.0, 1.0, depth_mm=0.2), Pressed(ROD, 30.0, -8.0, force_n=0.5))


def pressed(kernel, monkeypatch, *loads: Pressed) -> Mirror:
    monkeypatch.setattr("zeromethod.simulation.contact.compliance.prism_kernel", lambda _: kernel)
    dents_of.__globals__["_dents"].cache_clear()
    return Mirror(dents_of(loads, RUBBER, PRISM))


def test_a_load_on_the_prism_is_a_half_spaces_and_what_the_body_adds(kernels, monkeypatch):
    kernel, (load, _) = kernels[COARSE], LOADS
    mirror = pressed(kernel, monkeypatch, load)
    assert mirror.depth(42.0, 1.0) == pytest.approx(0.2, rel=1e-6)
    # the force that is 0.2 mm deep with what the body adds there, spread by seven points a side
    at, weight = np.polynomial.hermite_e.hermegauss(7)
    weight = np.outer(weight, weight).ravel() / weight.sum() ** 2
    x, y = (each.ravel() for each in np.meshgrid(42.0 + 3.54 * at, 1.0 + 3.54 * at))
    lines = np.linspace(1, 75, 40), np.linspace(-29, 29, 30)
    places = np.stack([each.ravel() for each in np.meshgrid(*lines)])
    modulus = 1 / (1 - 0.49**2)
    added = kernel.between(np.concatenate((places, [[42.0], [1.0]]), axis=1), np.stack((x, y))) @ weight
    force = 0.2 / (1 / (np.sqrt(2 * np.pi) * 3.54 * modulus) + added[-1])
    away = ((places[0] - 42.0) ** 2 + (places[1] - 1.0) ** 2) / (4 * 3.54**2)
    exact = force * (ive(0, away) / (np.sqrt(2 * np.pi) * 3.54 * modulus) + added[:-1])
    np.testing.assert_allclose(mirror.depth(*places), exact, atol=2e-5)  # a map of 1.25 mm, 1e-4


def test_loads_on_the_prism_by_depth_and_by_force_add_up(kernels, monkeypatch):
    x, y = np.meshgrid(np.linspace(5, 72, 30), np.linspace(-25, 25, 20))
    both, *single = (pressed(kernels[COARSE], monkeypatch, *loads) for loads in (LOADS, LOADS[:1], LOADS[1:]))
    np.testing.assert_allclose(both.depth(x, y), sum(one.depth(x, y) for one in single), atol=1e-12)
    # held on two faces, less deep than on a half-space
    assert single[1].depth(30.0, -8.0) < dents_of(LOADS[1:], Rubber(support="free"))[0].depth_mm
    by_depth = pressed(
        kernels[COARSE], monkeypatch, Pressed(ROD, 30.0, -8.0, depth_mm=float(single[1].depth(30.0, -8.0)))
    )
    np.testing.assert_allclose(by_depth.depth(x, y), single[1].depth(x, y), rtol=1e-5)


def test_finer_elements_change_what_loads_do_by_two_per_mille(kernels, monkeypatch):
    x, y = np.meshgrid(np.linspace(15, 65, 30), np.linspace(-20, 20, 20))
    coarse, fine = (pressed(kernel, monkeypatch, *LOADS).depth(x, y) for kernel in kernels.values())
    # a bench has twice as fine elements as the coarse ones: 1.4 times finer ones change it by 1.5e-4
    np.testing.assert_allclose(coarse, fine, atol=2e-3 * np.abs(fine).max())
