"""A cloth on the mirror and a projector's picture on it: two renderers alike, shares of area, clocks."""

from dataclasses import replace

import numpy as np
import pytest
from small_rigs import with_tables

from zeromethod import InputError, binned, load_rig
from zeromethod.clock import SimulatedClock
from zeromethod.interactive.homography import corners_px, homography, mapped, mm_to_px
from zeromethod.rig.model import ProjectorSpec
from zeromethod.simulation.cloth import cloth_of
from zeromethod.simulation.gpu import GpuRenderer
from zeromethod.simulation.numpy_renderer import NumpyRenderer
from zeromethod.simulation.press import Dent, Mirror, Shape
from zeromethod.simulation.projected import SimulatedProjector, true_map
from zeromethod.simulation.renderer import Piece

RIG = binned(load_rig("interactive"), 8).replace({"cloth.weave_mm": 1.2})
SPEC = RIG.projector
assert SPEC is not None


def _picture():
    """Grey that grows along columns, its lower half darker."""
    picture = np.tile(np.linspace(0, 1, SPEC.columns, dtype=np.float32), (SPEC.rows, 1))
    picture[SPEC.rows // 2 :] *= np.float32(0.3)
    return picture


def _exposed(renderer, mirror, grey, projected):
    display = RIG.display
    handle = renderer.upload(np.full((display.rows, display.columns), grey, np.uint8))
    share = np.ones(display.rows, np.float32)
    return renderer.expose([Piece(1.0, mirror, [(handle, share)])], projected).copy()


@pytest.mark.parametrize("slope", [0.0, 0.06], ids=["rest", "dent that ends total reflection"])
def test_shader_and_numpy_see_the_same_projected_light(slope):
    sigma = 5.0
    depth = slope * sigma * np.exp(0.5)
    dents = (Dent(Shape.GAUSSIAN, 42.0, 0.0, depth, sigma),) if slope else ()
    mirror = Mirror(dents, cloth=cloth_of(RIG))
    both = [renderer(RIG) for renderer in (NumpyRenderer, GpuRenderer)]
    dark, lit = ([_exposed(one, mirror, 0, light) for one in both] for light in (None, _picture()))
    assert lit[0].mean() > 1.5 * dark[0].mean() + 1e-3
    off = np.abs((lit[0] - dark[0]) - (lit[1] - dark[1]))
    # float32 in the shader moves a thread's soft border by 1e-3 of itself, and single pixels next to the
    # critical angle, where light through the mirror begins at once
    assert np.percentile(off, 99.5) < 1e-3
    assert off.mean() < 1e-4


def test_threads_cover_the_shares_of_the_area_that_the_rig_gives():
    cloth = cloth_of(RIG)
    draw = np.random.default_rng(1)
    x, y = draw.uniform(-40, 40, (2, 200_000))
    spec = cloth.spec
    # 200,000 points know a share of 0.05 to 0.0005, and radii differ by 5 %, which squares feel as 0.3 %;
    # pressed, soft borders of neighbours cut each other off by 0.007
    assert cloth.share(x, y, np.full(x.shape, np.inf)).mean() == pytest.approx(spec.touching, abs=0.002)
    assert cloth.share(x, y, np.zeros(x.shape)).mean() == pytest.approx(spec.pressed, abs=0.01)


def test_a_wall_of_light_is_seen_by_threads_alone_where_reflection_is_total():
    renderer = NumpyRenderer(RIG)
    white = np.ones((SPEC.rows, SPEC.columns), np.float32)
    at_rest = Mirror(cloth=cloth_of(RIG))
    seen = _exposed(renderer, at_rest, 0, white)
    lit = seen > 0
    # 5 % of the area, each thread 1 / n^2, and 7 % of that again by way of the pattern face
    assert seen.mean() == pytest.approx(0.05 / 1.41**2, rel=0.15)
    assert lit.mean() < 0.6


def test_pictures_come_at_the_projectors_own_refreshes_and_exposures_mix_them():
    clock = SimulatedClock()
    projector = SimulatedProjector(SPEC, clock)
    assert projector.luminance(0, 1_000_000) is None
    clock.sleep_until_ns(10_000_000)
    projector.show(np.full((SPEC.rows, SPEC.columns), 255, np.uint8))
    swap_ns = round(1e9 * 1.37 / 60)
    assert projector.luminance(swap_ns - 2_000_000, swap_ns - 1) is None
    half = projector.luminance(swap_ns - 1_000_000, swap_ns + 1_000_000)
    assert half.mean() == pytest.approx(0.5, abs=1e-6)
    whole = projector.luminance(swap_ns, swap_ns + 1_000_000)
    assert whole is projector.luminance(swap_ns, swap_ns + 2_000_000)  # not uploaded again
    with pytest.raises(InputError, match=r"picture: .*allowed is"):
        projector.show(np.zeros((4, 4), np.uint8))


def test_homography_takes_corners_to_corner_pixels_and_back():
    there = mm_to_px(SPEC)
    np.testing.assert_allclose(mapped(there, SPEC.corners_mm), corners_px(SPEC), atol=1e-8)
    points = np.random.default_rng(2).uniform(10, 70, (50, 2))
    again = homography(mapped(there, points), points)  # by the normal equations
    np.testing.assert_allclose(mapped(again, mapped(there, points)), points, atol=1e-5)


def test_the_true_map_is_that_of_corners_moved():
    off = ((0.5, 0.0), (0.0, -0.5), (0.3, 0.3), (0.0, 0.0))
    moved = with_tables(RIG, simulation={"projector_off_mm": off})
    corners = np.array(SPEC.corners_mm) + np.array(off)
    np.testing.assert_allclose(mapped(true_map(moved), corners), corners_px(SPEC), atol=1e-8)


def test_a_field_with_crossed_sides_is_refused_in_one_line():
    crossed = ((0.0, 0.0), (10.0, 10.0), (0.0, 10.0), (10.0, 0.0))
    with pytest.raises(InputError, match=r"corners_mm: .*the sides cross or bend inwards"):
        ProjectorSpec(corners_mm=crossed)


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"cloth": None}, 'projector.driver: "simulated"'),
        ({"camera.pupil_mm": 1.0}, "cloth: .*not simulated"),
        ({"control.rubbing": True}, "control.rubbing: true: false under a cloth"),
        ({"cloth.pressed": 0.9}, "cloth.pressed: 0.9"),
        ({"projector.monitor": -1}, "projector.monitor: -1"),
        ({"projector.picture": "film"}, 'projector.picture: "film"'),
    ],
)
def test_rigs_that_cannot_be_are_refused(values, words):
    with pytest.raises(InputError, match=words):
        RIG.replace(values)


def test_without_a_projector_exposures_are_those_of_before():
    rig = RIG.replace({"projector": None, "cloth": None})
    renderer = GpuRenderer(rig)
    display = rig.display
    handle = renderer.upload(np.full((display.rows, display.columns), 128, np.uint8))
    pieces = [Piece(1.0, Mirror(), [(handle, np.ones(display.rows, np.float32))])]
    plain = renderer.expose(pieces).copy()
    np.testing.assert_array_equal(
        plain, renderer.expose(pieces, np.ones((SPEC.rows, SPEC.columns), np.float32))
    )


def test_cloth_is_woven_once_per_rig():
    other = replace(cloth_of(RIG), weave=cloth_of(RIG).weave)
    assert cloth_of(RIG) is cloth_of(RIG.replace({"scenario": "none"}))
    assert other != cloth_of(RIG)
