"""Light at the camera's pixels, against what optics and photometry say."""

import re

import numpy as np
import pytest
from small_rigs import with_tables

from zeromethod.errors import InputError
from zeromethod.optics import Dented, Lost, Optics
from zeromethod.simulation.beams import Beams
from zeromethod.simulation.gpu import GpuRenderer
from zeromethod.simulation.numpy_renderer import NumpyRenderer
from zeromethod.simulation.press import Dent, Mirror, Shape
from zeromethod.simulation.renderer import BenchRenderer, Piece

DENTED = Mirror((Dent(Shape.GAUSSIAN, 38.0, 2.0, 0.1, 5.0),))
FULL = {"fill_factor": (1.0, 1.0), "gamma": 1.0}


def exposed(rig, picture, mirror=DENTED) -> np.ndarray:
    renderer: BenchRenderer = NumpyRenderer(rig)
    handle = renderer.upload(picture)
    share = np.ones(rig.display.rows, np.float32)
    return renderer.expose([Piece(1.0, mirror, [(handle, share)])])


def grey(rig, code: int) -> np.ndarray:
    return np.full((rig.display.rows, rig.display.columns), code, np.uint8)


def arriving(rig, mirror=DENTED) -> np.ndarray:
    _, reflectance = NumpyRenderer(rig).ray_map(mirror)
    return reflectance > 0


def test_a_white_lcd_without_gaps_gives_light_one_wherever_rays_arrive(make_rig):
    rig = make_rig(display=FULL)
    light = exposed(rig, grey(rig, 255))
    assert light.dtype == np.float32
    assert light.shape == (rig.camera.rows, rig.camera.columns)
    arrives = arriving(rig)
    assert arrives.mean() > 0.9
    np.testing.assert_allclose(light[arrives], 1.0, atol=2e-6)


def test_apertures_are_normalised_by_their_fill(make_rig):
    rig = make_rig(display={"fill_factor": (0.6, 0.5), "gamma": 1.0, "stripes": "rgb"})
    light = exposed(rig, grey(rig, 255))
    # not normalised it were 0.3; the beat of camera and LCD lattice over a finite view leaves some 0.3 %
    assert light[arriving(rig)].mean() == pytest.approx(1.0, abs=0.01)


def test_light_follows_the_response(make_rig):
    rig = make_rig(display=FULL | {"gamma": 2.2})
    light = exposed(rig, grey(rig, 128))
    np.testing.assert_allclose(light[arriving(rig)], (128 / 255) ** 2.2, rtol=1e-5)
    table = make_rig(display=FULL | {"response_light": (0.1, 0.2, 0.9)})
    light = exposed(table, grey(table, 51))
    np.testing.assert_allclose(light[arriving(table)], 0.1 + 0.1 * 51 / 127.5, rtol=1e-5)


@pytest.mark.parametrize("axis", [0, 1])
def test_a_ramp_on_the_lcd_is_seen_where_the_exact_rays_end(make_rig, axis):
    rig = make_rig(display=FULL)
    size = (rig.display.columns, rig.display.rows)
    ramp = np.rint(np.arange(size[axis]) / (size[axis] - 1) * 255).astype(np.uint8)
    picture = np.broadcast_to(ramp if axis == 0 else ramp[:, None], size[::-1]).copy()
    v, u = np.mgrid[0 : rig.camera.rows, 0 : rig.camera.columns].astype(float)
    trace = NumpyRenderer(rig).ray_map(DENTED)[0][..., axis]
    exact = Optics(rig).trace(u, v, Dented(Optics(rig).rest, DENTED)).q[..., axis]
    np.testing.assert_allclose(trace, exact, atol=1e-4)  # float32 of positions up to 480 px
    known = ~np.isnan(exact)
    light = exposed(rig, picture)
    # codes are rounded to 1/255: half of that per pixel, less when several are averaged
    np.testing.assert_allclose(light[known], exact[known] / (size[axis] - 1), atol=0.6 / 255)


def test_what_touches_takes_the_light_inside_its_contact(make_rig):
    rig = make_rig(display=FULL)
    ball = Mirror((Dent(Shape.BALL, 38.6, 0.0, 0.05, 60.0, contact_mm=1.7, touch_reflectance=0.05),))
    light = exposed(rig, grey(rig, 255), ball)
    v, u = np.mgrid[0 : rig.camera.rows, 0 : rig.camera.columns].astype(float)
    point = Optics(rig).trace(u, v, Optics(rig).rest).point
    r = np.hypot(point[..., 0] - 38.6, point[..., 1])
    np.testing.assert_allclose(light[r < 1.3], 0.05, atol=1e-6)
    np.testing.assert_allclose(light[arriving(rig, ball) & (r > 2.1)], 1.0, atol=2e-6)


def test_below_total_reflection_the_light_is_fresnels_share(make_rig):
    # critical angle 50.3 deg: half the view is below
    rig = with_tables(make_rig(display=FULL), prism={"index": 1.30})
    v, u = np.mgrid[0 : rig.camera.rows, 0 : rig.camera.columns].astype(float)
    optics = Optics(rig)
    trace = optics.trace(u, v, optics.rest)
    dimmed = trace.lost == Lost.BELOW_TIR
    assert 0.1 < dimmed.mean() < 0.9
    light = exposed(rig, grey(rig, 255), Mirror())
    np.testing.assert_allclose(light[dimmed], trace.reflectance[dimmed], atol=2e-6)


def test_ambient_light_is_added_and_blur_keeps_uniform_light(make_rig):
    rig = make_rig(display=FULL, camera={"psf_px": 1.2}, simulation={"ambient": 0.07})
    dark = exposed(rig, grey(rig, 0))
    np.testing.assert_allclose(dark, 0.07, atol=1e-6)


def test_blur_is_a_gaussian_of_psf_px(make_rig):
    sharp, soft = (make_rig(display=FULL, camera={"psf_px": s}) for s in (0.0, 1.5))
    picture = grey(sharp, 0)
    picture[:, 240:] = 255
    edges = [np.diff(exposed(r, picture, Mirror())[30].astype(float)) for r in (sharp, soft)]
    at = np.arange(len(edges[0]))
    spreads = []
    for edge in edges:
        near = slice(int(np.argmax(np.abs(edges[0]))) - 8, int(np.argmax(np.abs(edges[0]))) + 9)
        weight = edge[near] / edge[near].sum()
        spreads.append(weight @ at[near] ** 2 - (weight @ at[near]) ** 2)
    # sampled Gaussian cut at 4 sigma: variance within 1 %
    assert spreads[1] - spreads[0] == pytest.approx(1.5**2, rel=0.01)


def test_pieces_and_pictures_mix_as_light(make_rig):
    rig = make_rig(display=FULL | {"gamma": 2.2})
    renderer = NumpyRenderer(rig)
    black, white, middle = (renderer.upload(grey(rig, code)) for code in (0, 255, 128))
    half = np.full(rig.display.rows, 0.5, np.float32)
    pieces = [
        Piece(0.25, Mirror(), [(black, half), (white, half)]),
        Piece(0.75, DENTED, [(middle, 2 * half)]),
    ]
    light = renderer.expose(pieces)
    both = arriving(rig) & arriving(rig, Mirror())
    np.testing.assert_allclose(light[both], 0.25 * 0.5 + 0.75 * (128 / 255) ** 2.2, rtol=1e-5)


def test_gap_ghost_is_displaced_by_the_double_bounce(make_rig):
    """Flat mirror, 50/50 prism: a ray leaves the pattern face at the angle at which it entered."""
    rig = make_rig(simulation={"ghost_gap": 0.04})
    optics = Optics(rig)
    (main, ghost), _ = Beams(rig).all(Mirror())
    v, u = np.mgrid[0 : rig.camera.rows, 0 : rig.camera.columns].astype(float)
    _, direction = optics.camera_rays(u, v)
    normal = optics.prism.camera_face.normal
    tangent = np.sqrt(1 / (direction @ normal) ** 2 - 1)
    known = ~np.isnan(main.q[..., 0])
    shift_px = np.linalg.norm(ghost.q - main.q, axis=-1)
    expected = 2 * 0.5 * tangent / rig.display.pitch_mm
    np.testing.assert_allclose(shift_px[known], expected[known], atol=1e-9)
    np.testing.assert_allclose(ghost.gain, 0.04 * main.gain)
    # away from where the ray leaves the face normally, the ghost lies on the far side
    centre = main.q[np.unravel_index(np.nanargmin(np.where(known, tangent, np.nan)), u.shape)]
    outwards = np.sum((main.q - centre) * (ghost.q - main.q), axis=-1)
    assert np.all(outwards[known & (shift_px > 0.05)] > 0)


def test_faces_ghost_follows_the_ray_unfolded_in_the_five_planes(make_rig):
    """A ray's line after a reflection is its mirror image in the plane: independent of any intersection."""
    rig = make_rig(simulation={"ghost_faces": 0.02})
    optics = Optics(rig)
    ghost = Beams(rig).all(Mirror())[0][-1]
    v, u = np.mgrid[0 : rig.camera.rows, 0 : rig.camera.columns].astype(float)
    point, direction = optics.rubber_rays(u, v)
    mirror = (np.zeros(3), np.array([0.0, 0.0, 1.0]))
    pattern, camera_face = ((f.edge, f.normal) for f in (optics.prism.pattern_face, optics.prism.camera_face))
    for on, n in (mirror, pattern, mirror, camera_face, mirror):
        point = point - 2 * ((point - on) @ n)[..., None] * n
        direction = direction - 2 * (direction @ n)[..., None] * n
    known = ghost.gain > 0
    assert known.mean() > 0.5
    below = point - ((point[..., 2]) / direction[..., 2])[..., None] * direction  # on the mirror's plane
    leaves = optics.rubber_direction_to_lcd(below, ghost.q)
    np.testing.assert_allclose(leaves[known], direction[known], atol=1e-9)
    assert ghost.gain.max() == pytest.approx(0.02)


def test_ghosts_add_their_light(make_rig):
    rig = make_rig(display=FULL, simulation={"ghost_faces": 0.02, "ghost_gap": 0.03})
    light = exposed(rig, grey(rig, 255), Mirror())
    assert light[32, 40] == pytest.approx(1.05, abs=1e-5)


@pytest.mark.parametrize("kind", [NumpyRenderer, GpuRenderer])
def test_wrong_pictures_are_refused_in_one_line(make_rig, kind):
    renderer: BenchRenderer = kind(make_rig())
    for bad in (np.zeros((3, 4), np.uint8), np.zeros((270, 480), np.float32)):
        refusal = f"picture: {bad.shape} {bad.dtype}: allowed is (270, 480) uint8"
        with pytest.raises(InputError, match=f"^{re.escape(refusal)}$"):
            renderer.upload(bad)
    renderer.close()
    renderer.close()
