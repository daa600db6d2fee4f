"""Pixels to rays and back, OpenCV's own projection as the judge."""

import cv2
import numpy as np
import pytest

from zeromethod.optics.camera import CameraModel, undistort
from zeromethod.rig.load import load_rig

from .optics_shapes import close

DISTORTION = (-0.21, 0.09, 0.0013, -0.0007, 0.011)


def camera(**update):
    return CameraModel.place(load_rig("simulated").camera.model_copy(update=update))


def test_pixels_agree_with_opencv():
    pose = {"roll_deg": 17.0, "position_mm": (120.0, 9.0, -90.0), "look_at_mm": (40.0, -3.0, 2.0)}
    bench = camera(focal_px=(1400.0, 1450.0), distortion=DISTORTION, **pose)
    rng = np.random.default_rng(2)
    points = rng.uniform([0, -20, -30], [80, 20, 0], size=(200, 3))
    rotation = np.stack([bench.u_axis, bench.v_axis, bench.axis])
    assert np.linalg.det(rotation) == pytest.approx(1.0)
    matrix = np.array([[1400.0, 0, 639.5], [0, 1450.0, 511.5], [0, 0, 1]])
    expected, _ = cv2.projectPoints(
        points, cv2.Rodrigues(rotation)[0], -rotation @ bench.position, matrix, np.array(DISTORTION)
    )
    u, v = bench.project(points)
    # 1e-9 px: cv2.Rodrigues' angles carry about 1e-13 rad
    close(np.stack([u, v], axis=-1), expected[:, 0], 1e-9)


@pytest.mark.parametrize("projection", ["perspective", "orthographic"])
def test_a_pixels_ray_projects_back_onto_it(projection):
    bench = camera(projection=projection, pixel_mm=0.03, distortion=DISTORTION, focal_px=(1300.0, 1310.0))
    u, v = np.meshgrid(np.linspace(0, 1279, 30), np.linspace(0, 1023, 25))
    origin, direction = bench.rays(u, v)
    for distance in (50.0, 400.0):
        # 1e-9 px: 1e-14 of normalised coordinates times focal length, with room
        close(bench.project(origin + distance * direction), [u, v], 1e-9)


def test_positions_that_no_ideal_point_reaches_are_nan():
    """k1 = -0.5 folds at r = 0.816, where the radius in the image peaks at 0.544."""
    x, y = undistort(np.array([0.5, 0.6, np.nan]), np.zeros(3), (-0.5, 0.0, 0.0, 0.0, 0.0))
    assert np.isfinite(x[0])
    assert np.isnan(x[1:]).all()
    assert np.isnan(y[1:]).all()


def test_the_centre_pixel_looks_at_the_look_at_point():
    for projection in ("perspective", "orthographic"):
        bench = camera(projection=projection, pixel_mm=0.05)
        u, v = bench.project(np.array([bench.spec.look_at_mm]))
        close([u[0], v[0]], bench.spec.centre_px, 1e-9)
