"""The camera's pupil and objects in contact, as both renderers show them."""

from functools import cache

import numpy as np
import pytest
from scipy.ndimage import map_coordinates
from small_rigs import quarter

from zeromethod.errors import InputError
from zeromethod.fine.footprint import response
from zeromethod.optics import Optics
from zeromethod.optics.pupil import footprint_terms
from zeromethod.rig.model import Rig
from zeromethod.rig.tables import Rubber
from zeromethod.simulation.beams import Beams, scattered_view
from zeromethod.simulation.contact.objects import ALBEDO, Form, Held, Solid
from zeromethod.simulation.contact.scene import scene_of
from zeromethod.simulation.gpu import GpuRenderer
from zeromethod.simulation.numpy_renderer import NumpyRenderer
from zeromethod.simulation.press import Mirror
from zeromethod.simulation.pupil import points
from zeromethod.simulation.renderer import Piece

VIEW = {"columns": 160, "rows": 128, "centre_px": (79.5, 63.5)}
"""The middle of the view, with both contacts."""


def with_pupil(pupil_mm: float, **view) -> Rig:
    return quarter(camera={"pupil_mm": pupil_mm} | view)


@cache
def touched(albedo: float = 0.8) -> Mirror:
    ball = Held(Solid(Form.BALL, 20.0, albedo=albedo), 42.0, 1.0, depth_mm=0.04)
    rod = Held(
        Solid(Form.EDGE, 8.0, length_mm=6.0, angle_deg=30.0, albedo=albedo),
        36.0,
        -5.0,
        depth_mm=0.02,
        number=1,
    )
    scene = scene_of([ball, rod], Rubber())
    return Mirror(scene.dents, scene.touches)


def carrier_light(column: np.ndarray, gamma: float) -> np.ndarray:
    return ((127.5 + 110 * np.cos(2 * np.pi * column / 54)) / 255) ** gamma


def light(renderer, rig: Rig, mirror: Mirror, level: int | None = None) -> np.ndarray:
    shape = rig.display.rows, rig.display.columns
    if level is None:
        x = np.arange(shape[1])
        codes = np.broadcast_to(np.rint(127.5 + 110 * np.cos(2 * np.pi * x / 54)).astype(np.uint8), shape)
    else:
        codes = np.full(shape, level, np.uint8)
    handle = renderer.upload(np.ascontiguousarray(codes))
    image = renderer.expose([Piece(1.0, mirror, [(handle, np.ones(shape[0], np.float32))])]).copy()
    renderer.release(handle)
    return image


@cache
def exact(pupil_mm: float, albedo: float) -> tuple[np.ndarray, np.ndarray]:
    """(gain, light) in double precision, of a mirror that objects touch; for every OpenGL the same."""
    rig, mirror = with_pupil(pupil_mm, **VIEW), touched(albedo)
    renderer = NumpyRenderer(rig)
    return renderer.ray_map(mirror)[1], light(renderer, rig, mirror)


def test_the_footprint_of_5_mm_is_half_a_millimetre_along_and_a_third_across():
    rig = with_pupil(5.0)
    half_px = footprint_terms(rig)[0]
    optics = Optics(rig)
    u, v = rig.camera.centre_px
    points = optics.trace(np.array([u, u + 1, u]), np.array([v, v, v + 1]), optics.rest).point
    by_px = np.stack((points[1] - points[0], points[2] - points[0]), axis=-1)[:2]
    np.testing.assert_allclose(np.abs(2 * by_px @ half_px), [[0.563, 0], [0, 0.362]], atol=2e-3)


def test_points_of_the_pupil_see_waves_as_its_whole_disc_does():
    angle, radius = np.linspace(0.0, np.pi, 13), np.array([0.05, 0.5, 1.0, 1.5])
    k = radius[:, None, None] * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    seen = np.exp(1j * k @ points().T).mean(axis=-1)
    # rings of equal area stand for what lies between them: in the fourth moment, by a thousandth of a wave as
    # long as two pupils; where its middle is (the imaginary part) is exact
    np.testing.assert_allclose(seen.real, np.broadcast_to(response(radius)[:, None], seen.shape), atol=1e-3)
    np.testing.assert_allclose(seen.imag, 0.0, atol=1e-7)


@pytest.mark.parametrize("pupil_mm", [0.0, 1.25, 5.0])
def test_both_renderers_agree_on_objects_and_pupil(pupil_mm, gl_context):
    rig, mirror = with_pupil(pupil_mm, **VIEW), touched()
    gpu, (gain, seen) = GpuRenderer(rig, gl_context), exact(pupil_mm, 0.8)
    assert np.abs(gpu.ray_map(mirror)[1] - gain).max() < 2e-3
    wrong = np.abs(light(gpu, rig, mirror) - seen) > 2e-3
    gpu.close()
    # where rays cross right at a contact's rim both make something up
    assert wrong.sum() <= 16


def test_white_objects_scatter_more_than_black_ones_and_all_hide_the_picture(gl_context):
    rig = with_pupil(1.25, **VIEW)
    renderer = GpuRenderer(rig, gl_context)
    inside = {}
    for name, albedo in ALBEDO.items():
        mirror = touched(albedo)
        inside[name] = light(renderer, rig, mirror)[renderer.ray_map(mirror)[1] < 1e-3]
    panel = light(renderer, rig, Mirror()).mean()
    renderer.close()
    for name, albedo in ALBEDO.items():
        assert inside[name].size > 50
        assert np.ptp(inside[name]) < 1.2e-3  # no stripe of the picture but what is left of the reflection
        assert inside[name].mean() == pytest.approx(albedo * scattered_view(rig.prism) * panel, rel=0.1)


def test_the_pupils_mean_is_that_of_the_pictures_its_points_see():
    """Means of light over 200 points of the pupil, each with its own picture, next to the contacts."""
    rig, mirror = with_pupil(5.0, **VIEW), touched(0.04)
    point = rig.replace({"camera.pupil_mm": 0.0})
    beams = Beams(point)
    q, gain = beams.main(mirror)
    rest = beams.main(Mirror())[0]
    terms = footprint_terms(rig)
    v, u = np.mgrid[0 : rig.camera.rows, 0 : rig.camera.columns].astype(float)
    # the shift is the same both ways to a hundredth of a px, and changes along the view alone
    shift = (terms[0] + terms[1] * (2 * u / (rig.camera.columns - 1) - 1)[..., None, None])[..., 0, 0]
    lit = np.where(np.isnan(q[..., 0]), 0.0, gain)
    bent = np.where(lit > 0, q[..., 0] - rest[..., 0], 0.0)
    total = np.zeros(lit.shape)
    for k in range(200):
        radius, angle = np.sqrt((k + 0.5) / 200), 2.4 * k
        at = v + radius * np.sin(angle) * shift, u + radius * np.cos(angle) * shift
        share = map_coordinates(lit, at, order=1, mode="nearest")
        off = map_coordinates(lit * bent, at, order=1, mode="nearest") / np.maximum(share, 1e-9)
        total += share / 200 * carrier_light(rest[..., 0] + off, rig.display.gamma)
    image, sharp = exact(5.0, 0.04)[1], exact(0.0, 0.04)[1]
    beside = map_coordinates(gain, (v, u + 6), order=1, mode="nearest")
    near = (np.abs(beside - gain) > 0.01) & np.isfinite(total)
    # the lens, which is not in the sum, takes some 2 % of the contrast
    assert np.median(np.abs(image - total)[near]) < 0.02
    assert np.mean(np.abs(image - total)[near]) < 0.5 * np.mean(np.abs(sharp - total)[near])


def test_without_dents_a_pupil_changes_nothing(gl_context):
    small, point = (GpuRenderer(with_pupil(pupil_mm), gl_context) for pupil_mm in (3.0, 0.0))
    np.testing.assert_array_equal(
        light(small, with_pupil(3.0), Mirror()), light(point, with_pupil(0.0), Mirror())
    )
    small.close()
    point.close()


def test_a_pupil_of_parallel_rays_is_refused():
    values = {"camera.projection": "orthographic", "camera.pixel_mm": 0.1, "camera.pupil_mm": 1.0}
    with pytest.raises(InputError, match=r"camera.pupil_mm: 1.0: 0 for projection 'orthographic'"):
        quarter().replace(values)
