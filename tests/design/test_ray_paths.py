"""Drawn rays: every corner lies on its surface and obeys Snell or the law of reflection."""

import numpy as np
import pytest

from zeromethod.design import ray_paths
from zeromethod.optics import Lost, Optics

from .design_benches import GAP, PLATE, small, telecentric


def unit(vector: np.ndarray) -> np.ndarray:
    return vector / np.linalg.norm(vector)


@pytest.fixture(scope="module")
def oblique() -> tuple[Optics, list]:
    camera = {"position_mm": (270.0, 12.0, -215.0)}
    optics = Optics(small(pattern_layers=(PLATE, GAP), camera_layers=(PLATE,), camera=camera))
    return optics, ray_paths(optics, np.array([40.0, 160.0, 280.0]), np.array([30.0, 128.0, 220.0]))


def test_rays_bend_as_snell_says_and_reflect_evenly(oblique):
    optics, rays = oblique
    camera, pattern = optics.prism.camera_face.normal, optics.prism.pattern_face.normal
    for ray in rays:
        assert ray.lost is Lost.NONE
        # camera, plate's outside, face | mirror | face, plate's outside, LCD
        assert len(ray.points) == 7
        along = [unit(b - a) for a, b in zip(ray.points[:-1], ray.points[1:], strict=True)]
        indices = [1.0, 1.5, 1.41, 1.41, 1.5, 1.0]
        for k, normal in ((0, camera), (1, camera), (3, pattern), (4, pattern)):
            before, after = (indices[j] * np.cross(along[j], normal) for j in (k, k + 1))
            np.testing.assert_allclose(before, after, atol=1e-9)
        assert along[3][2] == pytest.approx(-along[2][2])
        np.testing.assert_allclose(along[3][:2], along[2][:2], atol=1e-9)


def test_rays_end_where_the_trace_does(oblique):
    optics, rays = oblique
    trace = optics.trace(np.array([160.0]), np.array([128.0]), optics.rest)
    np.testing.assert_allclose(rays[1].points[-1], optics.lcd_to_world(trace.q)[0])
    np.testing.assert_allclose(rays[1].points[3], trace.point[0])


def test_a_ray_that_misses_the_prism_ends_at_the_camera():
    optics = Optics(telecentric(pixel_mm=90.0 / 320))
    (ray,) = ray_paths(optics, np.array([0.0]), np.array([127.5]))
    assert ray.lost is Lost.MISSES_CAMERA_FACE
    assert len(ray.points) == 1
