"""From LCD codes to camera light: apertures, blur, ghosts, mixing; against integrals and the numpy bench."""

from collections.abc import Iterator
from typing import Any

import moderngl
import numpy as np
import pytest
from numpy.polynomial.polynomial import polyvander2d
from numpy.typing import NDArray
from scipy.special import ndtr
from small_rigs import quarter, with_tables

from zeromethod import Rig, load_rig
from zeromethod.gl import create_context
from zeromethod.optics import Dented, Optics
from zeromethod.pattern import Response
from zeromethod.simulation.gpu import GpuRenderer
from zeromethod.simulation.numpy_renderer import NumpyRenderer
from zeromethod.simulation.press import Dent, Mirror, Shape
from zeromethod.simulation.renderer import BenchRenderer, Piece

REST = Mirror()
PRESSED = Mirror((Dent(Shape.GAUSSIAN, 38.0, 1.0, 0.2, 5.0, contact_mm=1.0),))
BALL = Mirror((Dent(Shape.BALL, 36.0, -1.0, 0.15, 8.0),))


def _sharp(**tables: Any) -> Rig:
    """320x256 pixels of 3.4 LCD px, no blur."""
    return with_tables(quarter(camera={"psf_px": 0.0}), **tables)


def _window(psf_px: float = 0.0, **display: object) -> Rig:
    """96x64 pixels of full resolution (0.84 LCD px each) over the flank of the press."""
    camera = {"columns": 96, "rows": 64, "centre_px": (39.5, 161.5), "psf_px": psf_px}
    return with_tables(load_rig("simulated"), camera=camera, display=display)


def _codes(rig: Rig, seed: int = 0) -> NDArray[np.uint8]:
    shape = rig.display.rows, rig.display.columns
    return np.random.default_rng(seed).integers(0, 256, shape, dtype=np.uint8)


def _ones(rig: Rig) -> NDArray[np.float32]:
    return np.ones(rig.display.rows, dtype=np.float32)


def _light(
    renderer: BenchRenderer, rig: Rig, codes: NDArray[np.uint8], mirror: Mirror
) -> NDArray[np.float32]:
    handle = renderer.upload(codes)
    light = renderer.expose([Piece(1.0, mirror, [(handle, _ones(rig))])]).copy()
    renderer.release(handle)
    return light


def _both(
    context: moderngl.Context, rig: Rig, codes: NDArray[np.uint8], mirror: Mirror
) -> list[NDArray[np.float32]]:
    """Light of the shaders, and of the numpy bench."""
    gpu = GpuRenderer(rig, context)
    lights = [_light(renderer, rig, codes, mirror) for renderer in (gpu, NumpyRenderer(rig))]
    gpu.close()
    return lights


@pytest.fixture(scope="module")
def context() -> Iterator[moderngl.Context]:
    made = create_context()
    yield made
    made.release()


@pytest.mark.parametrize("fill", [(1.0, 1.0), (0.9, 0.85)])
def test_white_panel_gives_the_reflectance(fill, gl_context):
    rig = _sharp(display={"fill_factor": fill, "polarisation_deg": 90.0}, prism={"index": 1.33})
    renderer = GpuRenderer(rig, gl_context)
    light = _light(renderer, rig, np.full((rig.display.rows, rig.display.columns), 255, np.uint8), PRESSED)
    q, reflectance = renderer.ray_map(PRESSED)
    renderer.close()
    inside = (q > 5).all(axis=-1) & (q[..., 0] < rig.display.columns - 6) & (q[..., 1] < rig.display.rows - 6)
    assert inside.mean() > 0.3
    error = np.abs(light - reflectance)[inside]
    if fill == (1.0, 1.0):
        assert error.max() < 2e-4  # float32 footprints
    else:
        # single apertures beat with pixels of 3.4 of them, but not on average
        assert abs((light / np.maximum(reflectance, 1e-3))[inside & (reflectance > 0.1)].mean() - 1) < 2e-3
    assert reflectance[inside].min() < 0.1


def _integrated(
    rig: Rig, codes: NDArray[np.uint8], mirror: Mirror, pixels: NDArray[np.int_]
) -> NDArray[np.float64]:
    """Light at `pixels` (n, 2) as (u, v): 25600 points of the response, on exact rays fitted between.

    Each point counts as the pixel's box convolved with the lens's Gaussian says, out to 4 sigma. Points are
    spread by Roberts' R2 sequence: a grid of points would beat with the apertures.
    """
    optics, surface = Optics(rig), Dented(Optics(rig).rest, mirror)
    psf = rig.camera.psf_px
    reach, degree = (0.5, 1) if psf == 0 else (0.5 + 4 * psf, 5)
    t, s = (a.ravel() for a in np.meshgrid(*2 * [np.linspace(-1, 1, degree + 2)], indexing="ij"))
    rays = optics.trace(pixels[:, :1] + reach * s, pixels[:, 1:] + reach * t, surface).q
    reflectance = optics.trace(pixels[:, 0].astype(float), pixels[:, 1].astype(float), surface).reflectance
    fit = np.einsum("kr,nrc->nkc", np.linalg.pinv(polyvander2d(s, t, [degree, degree])), rays)
    at = (0.5 + np.arange(25600)[:, None] * [0.7548776662466927, 0.5698402909980532]) % 1 * 2 - 1
    q = polyvander2d(*at.T, [degree, degree]) @ fit
    share = np.ones(len(at))
    if psf > 0:
        share = (ndtr((reach * at + 0.5) / psf) - ndtr((reach * at - 0.5) / psf)).prod(axis=1)
    share /= share.sum()
    whole = np.rint(q).astype(int)
    off = q - whole
    fill = rig.display.fill_factor
    if rig.display.stripes == "rgb":
        off[..., 0] = (off[..., 0] * 3 - np.rint(off[..., 0] * 3)) / 3
        lit = (np.abs(off[..., 0]) < fill[0] / 6) & (np.abs(off[..., 1]) < fill[1] / 2)
    else:
        lit = (np.abs(off[..., 0]) < fill[0] / 2) & (np.abs(off[..., 1]) < fill[1] / 2)
    light = (codes / 255.0) ** rig.display.gamma
    panel = light[whole[..., 1], whole[..., 0]]
    return np.asarray(reflectance * ((panel * lit) @ share) / (fill[0] * fill[1]))


@pytest.mark.parametrize(
    ("display", "psf_px", "mirror", "tolerance"),
    [
        # 25600 points, and float32 of positions up to 1000 px
        ({}, 0.0, REST, 0.002),
        ({"stripes": "rgb", "fill_factor": (0.7, 0.6)}, 0.0, REST, 0.002),
        ({"turn_deg": 90.0}, 0.0, REST, 0.002),
        ({}, 0.0, PRESSED, 0.02),
        # turned boxes stand in for the parallelogram: random codes are the worst that a panel can show
        ({"turn_deg": 30.0}, 0.0, REST, 0.03),
        # with a lens the points lie further apart and count unequally
        ({}, 0.7, REST, 0.005),
        ({"stripes": "rgb", "fill_factor": (0.7, 0.6)}, 0.7, REST, 0.005),
        ({"turn_deg": 90.0}, 0.7, REST, 0.005),
        ({"turn_deg": 30.0}, 0.7, REST, 0.006),
        # sheared by 0.2 and more, two products of the same moments stand in: 0.009 rms of noise of 0.17
        ({}, 0.7, PRESSED, 0.045),
    ],
    ids=str,
)
def test_apertures_are_integrated_over_the_pixels_response(display, psf_px, mirror, tolerance, context):
    rig = _window(psf_px, **display)
    codes = _codes(rig)
    renderer = GpuRenderer(rig, context)
    light = _light(renderer, rig, codes, mirror)
    renderer.close()
    rng = np.random.default_rng(1)
    pixels = np.stack((rng.integers(1, 95, 60), rng.integers(1, 63, 60)), axis=-1)
    error = light[pixels[:, 1], pixels[:, 0]] - _integrated(rig, codes, mirror, pixels)
    assert np.abs(error).max() < tolerance


TURNED = {"turn_deg": 20.0, "stripes": "rgb", "fill_factor": (0.6, 0.8)}
BENCHES = {
    "plain": _sharp,
    "ghosts": lambda: _sharp(simulation={"ghost_gap": 0.05, "ghost_faces": 0.1, "ambient": 0.03}),
    "turned, striped": lambda: _sharp(display=TURNED | {"gamma": 1.8}),
    "lens": lambda: _sharp(camera={"psf_px": 1.3}),
    "lens, turned, striped": lambda: _sharp(camera={"psf_px": 0.4}, display=TURNED),
    "paper": lambda: load_rig("paper"),
}


@pytest.mark.parametrize("name", BENCHES)
@pytest.mark.parametrize("mirror", [PRESSED, BALL], ids=["gaussian", "ball"])
def test_agrees_with_the_numpy_bench(name, mirror, context):
    rig = BENCHES[name]()
    codes = _codes(rig)
    light, expected = _both(context, rig, codes, mirror)
    error = np.abs(light - expected)
    # the shader takes a footprint skewed by less than 0.02 px for a box: up to 1e-3 on a picture of noise
    assert np.quantile(error, 0.999) < 2e-3
    assert expected.mean() > 0.1


@pytest.mark.parametrize("psf_px", [0.0, 0.7])
def test_lens_and_apertures_agree_with_the_numpy_bench_at_full_resolution(psf_px, context):
    rig = _window(psf_px)
    light, expected = _both(context, rig, _codes(rig), REST)
    # float32 of positions up to 1000 px: 6e-5 px on the border of an aperture of noise
    np.testing.assert_allclose(light, expected, atol=4e-4)


def test_each_place_of_the_panel_has_its_own_response(gl_context):
    """A panel drawn through the inverse of every place's response is evenly lit, and agrees with numpy's."""
    exponent = ((0.7, 1.0, 1.2), (1.0, 1.1, 1.5))
    rig = _sharp(display={"gamma": 2.2, "response_exponent": exponent})
    shape = rig.display.rows, rig.display.columns
    codes = Response.from_rig(rig.display).picture(np.full(shape, 0.4))
    assert np.ptp(codes.astype(int)) > 20
    lit, white = (_both(gl_context, rig, picture, REST) for picture in (codes, np.full(shape, 255, np.uint8)))
    inside = white[0] > 0.5
    for light, full in zip(lit, white, strict=True):
        # half a code of 190, at an exponent of 3.3 in all, is 0.9 % of the light
        np.testing.assert_allclose((light / np.maximum(full, 0.1))[inside], 0.4, rtol=9e-3)
    np.testing.assert_allclose(lit[0][inside], lit[1][inside], atol=1e-3)


def test_rows_mix_pictures_in_light_and_pieces_add(context):
    rig = _sharp(display={"gamma": 2.2})
    renderer, reference = GpuRenderer(rig, context), NumpyRenderer(rig)
    share = np.linspace(0.0, 1.0, rig.display.rows).astype(np.float32) ** 2
    images = []
    for each in (renderer, reference):
        first, second = each.upload(_codes(rig, 1)), each.upload(_codes(rig, 2))
        pieces = [
            Piece(0.25, REST, [(first, share), (second, 1 - share)]),
            Piece(0.45, PRESSED, [(second, _ones(rig))]),
            Piece(0.3, REST, [(first, _ones(rig))]),
        ]
        images.append(each.expose(pieces).copy())
    renderer.close()
    np.testing.assert_allclose(images[0], images[1], atol=3e-3)


def test_moving_press_and_changing_pictures_are_never_shown_from_memory(context):
    """A renderer that has drawn much else gives what a fresh one gives."""
    rig = _sharp()
    old = GpuRenderer(rig, context)
    for step in range(6):
        _light(old, rig, _codes(rig, step), Mirror((Dent(Shape.GAUSSIAN, 30.0 + step, 0.0, 0.1, 4.0),)))
    _light(old, rig, _codes(rig, 9), PRESSED)
    shown = _light(old, rig, _codes(rig, 10), PRESSED)
    old.close()
    fresh = GpuRenderer(rig, context)
    np.testing.assert_array_equal(shown, _light(fresh, rig, _codes(rig, 10), PRESSED))
    fresh.close()


def test_pictures_are_drawn_like_a_window_with_row_0_on_top(gl_context):
    rig = _sharp(display={"gamma": 1.0})
    renderer = GpuRenderer(rig, gl_context)
    handle, framebuffer = renderer.new_picture()
    rows, cols = rig.display.rows, rig.display.columns
    framebuffer.clear()
    framebuffer.clear(red=1.0, viewport=(0, rows // 2, cols, rows // 2))  # GL counts rows from the bottom
    drawn = renderer.expose([Piece(1.0, REST, [(handle, _ones(rig))])]).copy()
    codes = np.zeros((rows, cols), np.uint8)
    codes[: rows // 2] = 255
    np.testing.assert_allclose(drawn, _light(renderer, rig, codes, REST), atol=1e-6)
    renderer.release(handle)
    assert renderer.new_picture()[0] != handle  # a name is never given twice
    renderer.close()


def test_no_picture_leaves_the_ambient_light(context):
    renderer = GpuRenderer(_sharp(simulation={"ambient": 0.02}), context)
    np.testing.assert_allclose(renderer.expose([]), 0.02, rtol=1e-6)
    np.testing.assert_allclose(renderer.expose([Piece(1.0, REST, [])]), 0.02, rtol=1e-6)
    renderer.close()


def test_closes_twice_and_leaves_the_callers_context_alive(context):
    renderer = GpuRenderer(_sharp(), context)
    assert isinstance(renderer, BenchRenderer)
    renderer.close()
    renderer.close()
    assert context.buffer(b"1234").read() == b"1234"
    own = GpuRenderer(_sharp())
    own.ray_map(REST)
    own.close()
    own.close()


def test_a_lamps_light_is_reflected_twice_and_focused_by_the_mirror(gl_context):
    """Of a white print: R^2 times what a pixel sees of it at rest over what it sees now."""
    rig = _sharp(
        display={"fill_factor": (1.0, 1.0), "polarisation_deg": None},
        prism={"index": 1.38},
        control={"controller": "passive"},
        light={"source": "lamp"},
    )
    shape = rig.display.rows, rig.display.columns
    dry = Mirror((Dent(Shape.GAUSSIAN, 38.0, 1.0, 0.1, 5.0),))
    light, expected = _both(gl_context, rig, np.full(shape, 255, np.uint8), dry)
    optics = Optics(rig)
    v, u = np.mgrid[0 : rig.camera.rows, 0 : rig.camera.columns].astype(float)
    areas, reflectance = [], np.ones(0)
    for surface in (optics.rest, Dented(optics.rest, dry)):
        traced = optics.trace(u, v, surface)
        by_v, by_u = np.gradient(traced.q, axis=(0, 1))
        areas.append(np.abs(by_u[..., 0] * by_v[..., 1] - by_u[..., 1] * by_v[..., 0]))
        reflectance = traced.reflectance
    truth = reflectance**2 * np.nanmedian(areas[0]) / areas[1]
    q = traced.q
    inside = (q > 5).all(axis=-1) & (q[..., 0] < rig.display.columns - 6) & (q[..., 1] < rig.display.rows - 6)
    # total reflection ends at an edge that a pixel's differences straddle
    inside &= (truth < 3.0) & (reflectance > 0.05) & (np.hypot(*np.gradient(reflectance)) < 0.02)
    assert inside.mean() > 0.3
    assert truth[inside].max() > 1.15
    assert truth[inside].min() < 0.7
    # the shaders' rays are float32: areas of 3.4 x 3.4 LCD px to a part in a thousand
    assert np.abs(light - truth)[inside].max() < 0.02
    assert np.abs(expected - truth)[inside].max() < 0.005
