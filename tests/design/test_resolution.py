"""The pupil's footprint against similar triangles, half heights against the known transfer functions."""

import numpy as np
import pytest
from small_rigs import with_tables

from zeromethod.design import SampledView
from zeromethod.design.resolution import footprint_mm, resolution
from zeromethod.optics import Optics

from .design_benches import PUPIL_AWAY_MM, at_centre, small, telecentric

SIN, COS = np.sin(np.radians(50.0)), np.cos(np.radians(50.0))


def test_the_footprint_of_parallel_rays_is_their_cone_at_the_path(view):
    found = footprint_mm(view, 5.0)[view.on_lcd]
    # a pupil of 5 mm at 150 mm: a cone in air, narrower by the index in rubber, 1 / cos wider along x
    across = 5.0 / PUPIL_AWAY_MM / 1.41 * view.x_mm[view.on_lcd] * SIN
    # differences over 1 mm of pupil at 150 mm: (1/300)^2
    np.testing.assert_allclose(found, np.outer(across, [1 / COS, 1.0]), rtol=1e-4)


def test_the_footprint_of_a_lens_follows_similar_triangles():
    view = SampledView(small())
    middle = at_centre(view, view.trace.point)
    rubber = float(view.optics.prism.camera_face.depth_below(middle)), middle[0] * SIN
    camera_away = 280.0 + rubber[0] / 1.41
    lcd_away = rubber[1] / 1.41 + 0.5
    across = 5.0 * lcd_away / (camera_away + lcd_away)
    # the middle node lies half a node off the axis: 0.1 deg
    found = at_centre(view, footprint_mm(view, 5.0))
    np.testing.assert_allclose(found, [across / COS, across], rtol=5e-3)


def test_rays_from_the_pupils_rim_to_one_lcd_point_span_the_footprint():
    rig = small()
    view = SampledView(rig)
    j, i = view.u_px.shape[0] // 3, view.u_px.shape[1] // 4
    goal = view.trace.q[j, i]
    points = []
    for sign in (1, -1):
        position = view.optics.camera.position + sign * 2.5 * view.optics.camera.u_axis
        moved = with_tables(rig, camera={"position_mm": tuple(position)})
        u = view.u_px[j, i] + np.linspace(-8, 8, 65)
        v = np.full_like(u, view.v_px[j, i])
        trace = Optics(moved).trace(u, v, view.optics.rest)
        column = trace.q[:, 0] - goal[0]
        order = np.argsort(column)
        points.append(np.interp(0.0, column[order], trace.point[order, 0]))
    # one row of pixels only: v of the same LCD point differs by the fourth order
    assert abs(points[0] - points[1]) == pytest.approx(footprint_mm(view, 5.0)[j, i, 0], rel=2e-3)


def test_half_heights_are_those_of_triangle_and_disc():
    view = SampledView(telecentric(camera={"psf_px": 0.0}))
    found = resolution(view, 5.0)
    # a uniform disc passes half where 2 J1(x) / x = 1/2, x = 2.21509
    expected = np.pi / 2.21509 * np.array(found["footprint_mm"])
    np.testing.assert_allclose(found["aperture_wavelength_mm"], expected, rtol=1e-5)
    # a triangle of two boxes passes half where sinc(P f)^2 = 1/2, P f = 0.442946
    found = resolution(view, 1e-6)
    expected = np.array(found["window_mm"]) / 0.442946
    np.testing.assert_allclose(found["frame_wavelength_mm"], expected, rtol=1e-5)
