"""Every sign convention that the optics can show, one test each (see `zeromethod.optics.bench.Optics`)."""

import numpy as np
import pytest
from small_rigs import quarter

from zeromethod import load_rig
from zeromethod.optics import Dented, Flat, Optics, Sphere
from zeromethod.pattern import Target
from zeromethod.pattern.stepping import shift_of
from zeromethod.rig.model import Layer, Noise
from zeromethod.sensing import ResidualSensor
from zeromethod.warp.grid import NodeGrid

U, V = np.array([159.5]), np.array([127.5])


def bench(**parts):
    """Optics of the simulated rig at 320 x 256, each part updated by a dict."""
    return Optics(quarter(**parts))


class Slope:
    """A dent whose depth grows with x or y from a point."""

    def __init__(self, x, y, slope_x, slope_y):
        self.at, self.slopes = (x, y), (slope_x, slope_y)

    def depth(self, x, y):
        return (x - self.at[0]) * self.slopes[0] + (y - self.at[1]) * self.slopes[1]

    def slope(self, x, y):
        return np.full_like(x, self.slopes[0]), np.full_like(y, self.slopes[1])


def test_the_world_frame_is_right_handed_with_the_rubber_below():
    optics = bench()
    np.testing.assert_allclose(np.cross([0, 0, 1], [1, 0, 0]), [0, 1, 0])  # y = z cross x
    assert optics.prism.apex_mm[2] < 0
    np.testing.assert_array_equal(optics.prism.pattern_face.edge, [0, 0, 0])  # P0
    np.testing.assert_allclose(optics.prism.camera_face.edge, [optics.length_mm, 0, 0])  # R0


def test_face_normals_point_out_of_the_rubber():
    prism = bench().prism
    inside = np.array([prism.length_mm / 2, 0.0, -1.0])
    for face in (prism.pattern_face, prism.camera_face):
        assert (inside - face.edge) @ face.normal < 0
        assert face.depth_below(inside) > 0
    assert prism.pattern_face.normal[0] < 0 < prism.camera_face.normal[0]


def test_camera_columns_grow_with_x_and_rows_with_y():
    optics = bench()
    point = optics.trace(np.array([100.0, 200.0, 100.0]), np.array([50.0, 50.0, 90.0]), Flat()).point
    assert point[1, 0] > point[0, 0]
    assert point[2, 1] > point[0, 1]


def test_camera_axes_are_right_handed_u_v_forward():
    camera = bench().camera
    np.testing.assert_allclose(np.cross(camera.u_axis, camera.v_axis), camera.axis, rtol=0, atol=1e-15)
    np.testing.assert_allclose(np.cross(camera.v_axis, camera.axis), camera.u_axis, rtol=0, atol=1e-15)
    np.testing.assert_allclose(camera.v_axis, [0, 1, 0], rtol=0, atol=1e-15)


def test_positive_roll_turns_u_towards_v():
    straight, rolled = bench().camera, bench(camera={"roll_deg": 90.0}).camera
    np.testing.assert_allclose(rolled.u_axis, straight.v_axis, rtol=0, atol=1e-15)
    np.testing.assert_allclose(rolled.v_axis, -straight.u_axis, rtol=0, atol=1e-15)


def test_positive_k1_pushes_image_points_outwards():
    plain, pincushion = bench().camera, bench(camera={"distortion": (0.5, 0, 0, 0, 0)}).camera
    origin, direction = plain.rays(np.array([300.0]), np.array([127.5]))
    assert pincushion.project(origin + 100 * direction)[0][0] > 300.0


def test_pixel_centres_lie_at_integers():
    """Four by four pixels binned: the first large pixel's centre is that of pixels 0 to 3, at 1.5."""
    full = Optics(load_rig("simulated"))
    large, small = (
        bench().camera_rays(np.zeros(1), np.zeros(1)),
        full.camera_rays(np.full(1, 1.5), np.full(1, 1.5)),
    )
    np.testing.assert_allclose(large[1], small[1], rtol=0, atol=1e-14)


def test_lcd_columns_grow_away_from_p0_and_rows_with_y():
    points = bench().lcd_to_world(np.array([[0.0, 0.0], [100.0, 0.0], [0.0, 100.0]]))
    step = points[1] - points[0]
    assert step[0] > 0 > step[2]
    np.testing.assert_allclose(points[2] - points[0], [0, 6.3, 0], rtol=0, atol=1e-12)


def test_at_rest_lcd_columns_grow_with_u_and_rows_with_v():
    q = bench().rest_map(np.array([100.0, 110.0, 100.0]), np.array([50.0, 50.0, 60.0]))
    assert q[1, 0] > q[0, 0]
    assert q[2, 1] > q[0, 1]


def test_a_quarter_turn_makes_columns_grow_with_y_and_rows_towards_p0():
    panel = bench(display={"turn_deg": 90.0}).panel
    np.testing.assert_allclose(panel.column, [0, 1, 0], rtol=0, atol=1e-15)
    assert panel.row[0] < 0 < panel.row[2]


def test_mirroring_flips_the_columns_before_turning():
    plain, mirrored = bench().panel, bench(display={"mirrored": True}).panel
    np.testing.assert_allclose(mirrored.column, -plain.column)
    np.testing.assert_allclose(mirrored.row, plain.row)
    both = bench(display={"mirrored": True, "turn_deg": 90.0}).panel
    np.testing.assert_allclose(both.column, [0, 1, 0], rtol=0, atol=1e-15)
    np.testing.assert_allclose(both.row, plain.column, rtol=0, atol=1e-15)


def test_positive_tilt_about_along_brings_plus_y_nearer_to_the_prism():
    optics = bench(display={"tilt_deg": (1.0, 0.0)})
    near, far = (
        optics.prism.pattern_face.depth_below(optics.lcd_to_world(np.array([959.5, r]))) for r in (1000, 80)
    )
    assert near > far  # depth below the face is negative beyond it


def test_positive_tilt_about_y_takes_the_far_end_away_from_the_prism():
    optics = bench(display={"tilt_deg": (0.0, 1.0)})
    p0, apex = (
        optics.prism.pattern_face.depth_below(optics.lcd_to_world(np.array([c, 539.5]))) for c in (300, 1600)
    )
    assert apex < p0


def test_the_tilt_about_along_is_applied_first():
    panel = bench(display={"tilt_deg": (90.0, 90.0)}).panel
    # about along: rows turn from y to -normal; about y by 90 deg, x -> -z, z -> x: (x, y, z) -> (z, y, -x)
    x, y, z = -bench().panel.normal
    np.testing.assert_allclose(panel.row, [z, y, -x], rtol=0, atol=1e-15)


def test_polarisation_zero_is_s_at_the_mirror_and_ninety_is_p():
    """45 deg on the mirror, just below total reflection: s reflects better than p."""
    x, y, _ = bench().trace(U, V, Flat()).point[0]
    dim = Dented(Flat(), Slope(x, y, -0.0875, 0.0))
    s, p, mean = (
        bench(display={"polarisation_deg": a}).trace(U, V, dim).reflectance[0] for a in (0.0, 90.0, None)
    )
    assert s > mean > p
    assert mean == pytest.approx((s + p) / 2, abs=1e-4)


def test_depth_is_positive_into_the_rubber():
    class Press(Slope):
        def depth(self, x, y):
            return np.full_like(x, 0.2)

    point = bench().trace(U, V, Dented(Flat(), Press(0, 0, 0.0, 0.0))).point[0]
    assert point[2] == pytest.approx(-0.2)
    # met sooner, so nearer to the camera's side
    assert point[0] > bench().trace(U, V, Flat()).point[0, 0]


def test_the_normal_points_out_of_the_rubber_and_leans_to_growing_depth():
    optics = bench()
    rest = optics.trace(U, V, Flat())
    x, y, _ = rest.point[0]
    trace = optics.trace(U, V, Dented(Flat(), Slope(x, y, 0.01, 0.02)))
    _, incoming = optics.rubber_rays(U, V)
    normal = optics.normal_between(incoming, optics.rubber_direction_to_lcd(trace.point, trace.q))[0]
    assert normal[2] > 0
    np.testing.assert_allclose(
        normal[:2] / normal[2], [0.01, 0.02], rtol=0, atol=1e-12
    )  # slope of depth, not of z


@pytest.mark.parametrize(("slope", "column", "row"), [((0.001, 0.0), -1, 0), ((0.0, 0.001), 0, -1)])
def test_depth_that_grows_with_x_or_y_moves_the_reading_back(slope, column, row):
    """dd/dx > 0 moves q towards P0 (column down), dd/dy > 0 towards -y (row down); sensitivity agrees."""
    optics = bench()
    rest = optics.trace(U, V, Flat())
    moved = optics.trace(U, V, Dented(Flat(), Slope(*rest.point[0, :2], *slope))).q - rest.q
    # 1e-3 px: second order of 1 mrad at some 1000 px / rad
    assert np.sign(np.where(np.abs(moved[0]) < 1e-3, 0, moved[0])).tolist() == [column, row]
    np.testing.assert_allclose(optics.sensitivity(U, V)[0] @ slope, moved[0], rtol=0.01, atol=1e-3)


def test_depth_that_falls_with_x_eats_the_margin_of_total_reflection():
    """dd/dx < 0 lowers the angle of incidence, dd/dx > 0 raises it."""
    optics = bench()
    x, y, _ = optics.trace(U, V, Flat()).point[0]
    less, rest, more = (
        optics.trace(U, V, Dented(Flat(), Slope(x, y, s, 0.0))).cos_incidence[0] for s in (-0.02, 0.0, 0.02)
    )
    assert less > rest > more


def test_a_positive_radius_bulges_out_of_the_rubber():
    bulge = Sphere(100.0, (30.0, 0.0))
    assert bulge.height(np.array([30.0, 40.0]), np.zeros(2)).tolist()[0] == 0.0
    assert bulge.height(np.array([40.0]), np.zeros(1))[0] < 0.0
    assert bulge.gradient(np.array([40.0]), np.zeros(1))[0][0] < 0.0
    assert Sphere(-100.0, (30.0, 0.0)).height(np.array([40.0]), np.zeros(1))[0] > 0.0


def test_layers_are_listed_from_the_rubber_outwards():
    """Of a plate and an air gap the last listed is the gap, which alone varies in front of a tilted panel."""
    plate, air = Layer(index=1.5, thickness_mm=2.0), Layer(index=1.0, thickness_mm=1.0)
    display = {"tilt_deg": (0.0, 1.0), "centre_mm": (20.0, 0.0)}
    optics = Optics(quarter(pattern_layers=(plate, air), display=display))
    face, point = optics.prism.pattern_face, np.array([[38.0, 0.0, 0.0]])
    q = np.array([[1100.0, 539.5]])
    target = optics.lcd_to_world(q)
    gap = -face.depth_below(target)[0] - 2.0
    assert gap > 1.1
    direction = optics.rubber_direction_to_lcd(point, q)[0]
    sine = 1.41 * np.linalg.norm(np.cross(direction, face.normal))  # n sin(theta), the same in every slab
    shift = sum(
        t * sine / np.sqrt(n**2 - sine**2)
        for n, t in ((1.41, face.depth_below(point)[0]), (1.5, 2), (1, gap))
    )
    offset = target[0] - point[0]
    assert shift == pytest.approx(np.linalg.norm(np.cross(offset, face.normal)), abs=1e-12)


def test_a_target_moves_towards_smaller_u_and_v_first_and_its_phase_is_positive():
    """T_1(u, v) = T(u + P / 16, v + P / 8): the bright spot goes from (0, 0) to (-1, -2), and reads d > 0."""
    shift = shift_of(16, 1)
    assert shift == (1 / 16, 2 / 16)
    assert shift_of(16, 17)[0] == shift_of(16, 15)[0]  # there and back
    assert shift_of(16, 9)[1] == shift_of(16, 7)[1]  # at other times
    grid, target = NodeGrid((64, 64), 16), Target("cosines", 16)
    v, u = np.mgrid[:64, :64].astype(float)
    picture = target.light(u + 16 * shift[0], v + 16 * shift[1])
    row, column = np.unravel_index(np.argmax(picture[24:40, 24:40]), (16, 16))
    assert (column + 24 - 32, row + 24 - 32) == (-1, -2)
    sensor = ResidualSensor(grid, "cosines", Noise(), 8)
    image = np.rint(200 * picture).astype(np.uint8)
    # grey levels are rounded: 0.02 px
    assert np.abs(sensor.measure(image).d[grid.inner] - (1.0, 2.0)).max() < 0.02
    known = np.tile(2 * np.pi * np.array(shift), (*grid.shape, 1))
    np.testing.assert_allclose(sensor.measure(image, target_rad=known).d[grid.inner], 0.0, atol=0.02)
