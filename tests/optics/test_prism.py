"""Faces, edges and the panel's place."""

import numpy as np
import pytest

from zeromethod.optics.panel import Panel
from zeromethod.optics.prism import PrismGeometry
from zeromethod.rig.load import load_rig

from .optics_shapes import close


def prism(**update):
    spec = load_rig("simulated").prism
    return PrismGeometry(spec.model_copy(update=update))


@pytest.mark.parametrize(("a", "b"), [(50.0, 50.0), (45.0, 45.0), (40.0, 63.0)])
def test_the_faces_close_the_triangle(a, b):
    geometry = prism(pattern_angle_deg=a, camera_angle_deg=b)
    pattern, camera = geometry.pattern_face, geometry.camera_face
    assert pattern.length_mm == pytest.approx(60.0)
    close(camera.edge + camera.length_mm * camera.along, geometry.apex_mm, 1e-12)
    for face, other in ((pattern, camera.edge), (camera, pattern.edge)):
        assert face.along @ face.normal == pytest.approx(0.0, abs=1e-15)
        assert face.depth_below(other) > 0.0


def test_leg_and_mirror_length_say_the_same():
    by_leg = prism()
    by_mirror = prism(pattern_length_mm=None, mirror_length_mm=by_leg.length_mm)
    assert by_leg.length_mm == pytest.approx(60.0 * np.sin(np.radians(100)) / np.sin(np.radians(50)))
    assert by_mirror.pattern_face.length_mm == pytest.approx(60.0)


def test_a_face_ends_at_its_edges():
    face = prism().camera_face
    offset = np.array([-0.01, 0.01, 59.99, 60.01, 30.0, 30.0, np.nan])
    y = np.array([0.0, 0.0, 0.0, 0.0, 29.99, 30.01, 0.0])
    points = face.edge + offset[:, None] * face.along + y[:, None] * np.array([0.0, 1.0, 0.0])
    assert face.contains(points).tolist() == [False, True, True, False, True, False, False]


@pytest.mark.parametrize("mirrored", [False, True])
def test_lcd_positions_survive_the_world_and_back(mirrored):
    update = {"turn_deg": 31.0, "mirrored": mirrored, "tilt_deg": (2.0, -3.0), "centre_mm": (28.0, 4.0)}
    face = prism().pattern_face
    panel = Panel.place(load_rig("simulated").display.model_copy(update=update), face, 1.5)
    q = np.random.default_rng(3).uniform(-100, 2000, size=(7, 5, 2))
    points = panel.lcd_to_world(q)
    close(panel.world_to_lcd(points), q, 1e-10)
    close((points - panel.centre) @ panel.normal, 0.0, 1e-12)
    distances = np.linalg.norm(points[0, 0] - points[0, 1])
    assert distances == pytest.approx(0.063 * np.linalg.norm(q[0, 0] - q[0, 1]))
    middle = panel.lcd_to_world(np.array([959.5, 539.5]))
    close(middle, 28.0 * face.along + [0.0, 4.0, 0.0] + 1.5 * face.normal, 1e-12)


def test_the_panel_reaches_half_a_pixel_beyond_its_outer_centres():
    panel = Panel.place(load_rig("simulated").display, prism().pattern_face, 0.5)
    q = np.array([[-0.5, -0.5], [-0.51, 5], [1919.5, 1079.5], [5, 1079.51], [np.nan, 5]])
    assert panel.contains(q).tolist() == [True, False, True, False, False]
