"""The whole way, camera to LCD and back to the mirror's normal, against closed forms."""

import numpy as np
import pytest

from zeromethod.optics import Dented, Flat, Lost, Optics, Sphere, critical_angle_rad
from zeromethod.optics.vectors import dot, unit
from zeromethod.rig.load import load_rig
from zeromethod.rig.model import Layer

from .optics_shapes import Ramp, close, gaussian, perpendicular, pixels, random_rig, small

ACROSS = np.array([1.0, 1.0, -1.0])  # mirrors points and directions at z = 0


def test_a_flat_mirror_shows_the_mirror_image():
    """Unfolded at z = 0 the ray runs straight to the mirrored face, there bends by Snell, and goes on."""
    optics = Optics(small())
    u, v = pixels(optics.rig)
    trace = optics.trace(u, v, Flat())
    arrives = trace.reaches_display
    assert arrives.mean() > 0.95
    origin, direction = (a[arrives] for a in optics.rubber_rays(u, v))
    face = optics.prism.pattern_face
    normal = face.normal * ACROSS
    into = dot(face.edge - origin, normal) / dot(direction, normal)
    theta = np.arccos(dot(direction, normal))
    sideways = unit(direction - np.cos(theta)[:, None] * normal)
    shift = 0.5 * np.tan(np.arcsin(1.41 * np.sin(theta)))
    expected = origin + into[:, None] * direction + 0.5 * normal + shift[:, None] * sideways
    # 1e-11 mm: arccos near 1 loses digits
    close(optics.lcd_to_world(trace.q[arrives]) * ACROSS, expected, 1e-11)


def test_rays_enter_the_rubber_by_snell_and_from_the_face():
    optics = Optics(small(camera_layers=(Layer(index=1.49, thickness_mm=3.0),)))
    u, v = pixels(optics.rig)
    _, air = optics.camera_rays(u, v)
    origin, inside = optics.rubber_rays(u, v)
    face = optics.prism.camera_face
    close(face.depth_below(origin), 0.0, 1e-12)
    # a plate does not change the direction behind it
    close(np.cross(air, face.normal), 1.41 * np.cross(inside, face.normal), 1e-14)


def test_a_plate_on_the_camera_face_shifts_the_ray():
    """Met 3 mm before the face, the ray runs 3 mm tan(angle in the plate) sideways, not in the air."""
    optics = Optics(small(camera_layers=(Layer(index=1.49, thickness_mm=3.0),)))
    u, v = pixels(optics.rig)
    start, air = optics.camera_rays(u, v)
    face = optics.prism.camera_face
    cosine = -dot(air, face.normal)
    met = start + ((-face.depth_below(start) - 3.0) / cosine)[..., None] * air
    sine = np.sqrt(1 - cosine**2)
    sideways = unit(air + cosine[..., None] * face.normal)
    shift = 3.0 * np.tan(np.arcsin(sine / 1.49))
    expected = met - 3.0 * face.normal + shift[..., None] * sideways
    # 1e-12 mm: roundings of 300 mm
    close(optics.rubber_rays(u, v)[0], expected, 1e-12)


def test_a_spherical_rest_surface_reflects_about_its_radius():
    optics = Optics(small())
    sphere, centre = Sphere(400.0, (38.0, 0.0)), np.array([38.0, 0.0, -400.0])
    u, v = pixels(optics.rig)
    trace = optics.trace(u, v, sphere)
    arrives = np.isfinite(trace.q[..., 0])
    assert arrives.mean() > 0.5
    close(np.linalg.norm(trace.point[arrives] - centre, axis=-1), 400.0, 1e-11)
    _, incoming = optics.rubber_rays(u, v)
    outgoing = optics.rubber_direction_to_lcd(trace.point, trace.q)
    normal = optics.normal_between(incoming, outgoing)
    close(normal[arrives], ((trace.point - centre) / 400.0)[arrives], 1e-12)
    close(trace.cos_incidence[arrives], dot(incoming, normal)[arrives], 1e-12)


def test_the_normal_comes_back_from_what_a_dent_shows():
    optics = Optics(small())
    dent = gaussian(0.3, 4.0, 38.0, 2.0)
    u, v = pixels(optics.rig, 60)
    trace = optics.trace(u, v, Dented(Flat(), dent))
    _, incoming = optics.rubber_rays(u, v)
    normal = optics.normal_between(incoming, optics.rubber_direction_to_lcd(trace.point, trace.q))
    arrives = np.isfinite(trace.q[..., 0])
    assert arrives.mean() > 0.95
    slope = np.stack(dent.slope(trace.point[..., 0], trace.point[..., 1]), axis=-1)
    # depth = -z: slope is +(nx, ny) / nz
    close((normal[..., :2] / normal[..., 2:])[arrives], slope[arrives], 1e-10)


@pytest.mark.parametrize("seed", range(12))
def test_any_geometry_comes_back(seed):
    rng = np.random.default_rng(seed)
    optics = Optics(random_rig(rng))
    mirror = Dented(Sphere(rng.uniform(800, 2000), (35.0, 0.0)), gaussian(0.1, 4.0, 36.0, 1.0))
    u, v = pixels(optics.rig)
    trace = optics.trace(u, v, mirror)
    arrives = np.isfinite(trace.q[..., 0])
    assert arrives.mean() > 0.3
    _, incoming = optics.rubber_rays(u, v)
    normal = optics.normal_between(incoming, optics.rubber_direction_to_lcd(trace.point, trace.q))
    zx, zy = mirror.gradient(trace.point[..., 0], trace.point[..., 1])
    # 1e-10: near P0 the path to the LCD is short, so that roundings of 1e-13 px turn the ray by 1e-12
    gradient = -normal[..., :2] / normal[..., 2:]
    close(gradient[arrives], np.stack([zx, zy], axis=-1)[arrives], 1e-10)


def test_the_optical_lever_is_twice_the_slope_times_the_path():
    """At right angles to LCD and plane of incidence's y: dq = 2 t path in the plane, times cos(i) across."""
    optics = Optics(perpendicular())
    u, v = np.array([159.5]), np.array([127.5])
    rest = optics.trace(u, v, Flat())
    x, y, _ = rest.point[0]
    slope = 1e-5
    along = optics.trace(u, v, Dented(Flat(), Ramp(slope, 0.0, x, y)))
    across = optics.trace(u, v, Dented(Flat(), Ramp(0.0, slope, x, y)))
    cosine = np.cos(np.radians(50))
    assert rest.cos_incidence[0] == pytest.approx(cosine)
    lever = 2 * slope * rest.path_mm[0] / 0.063
    # 1e-4 relative: second order in the slope
    assert (along.q - rest.q)[0] == pytest.approx([-lever, 0.0], abs=1e-4 * lever)
    assert (across.q - rest.q)[0] == pytest.approx([0.0, -lever * cosine], abs=1e-4 * lever)


def test_a_tilted_lcd_is_met_where_it_is():
    """Tilted about y by t, with the ray at right angles to the face: the gap grows by offset x tan(t)."""
    layers = (Layer(index=1.0, thickness_mm=2.0),)
    flat = Optics(perpendicular(layers=layers))
    tilted = Optics(perpendicular(layers=layers, display={"tilt_deg": (0.0, 1.5)}))
    u, v = pixels(flat.rig, 9)
    rest, met = flat.trace(u, v, Flat()), tilted.trace(u, v, Flat())
    arrives = rest.reaches_display & met.reaches_display
    assert arrives.sum() > 40
    along = (rest.q[..., 0] - 959.5) * 0.063
    expected = rest.path_mm + along * np.tan(np.radians(1.5))
    close(met.path_mm[arrives], expected[arrives], 1e-12)
    close((met.q[..., 0] - 959.5)[arrives], (along / np.cos(np.radians(1.5)) / 0.063)[arrives], 1e-9)


def test_the_simulated_bench_is_usable_all_over():
    rig = load_rig("simulated")
    optics = Optics(rig)
    u, v = pixels(rig, 50)
    trace = optics.trace(u, v, optics.rest)
    margin = np.degrees(np.arccos(trace.cos_incidence) - critical_angle_rad(1.41))
    assert np.degrees(np.arccos(optics.centre().cos_incidence[0])) == pytest.approx(50.0, abs=0.02)
    assert 1.5 < np.nanmin(margin) < 2.2  # design.md: as little as 1.7 at the edge
    period = 16  # camera px, more than that many LCD px
    inside = (trace.q > period).all(axis=-1) & (trace.q < [1919 - period, 1079 - period]).all(axis=-1)
    assert ((trace.lost == Lost.NONE) & inside).mean() >= 0.98


def test_reasons_for_losing_a_ray():
    rig = small(prism={"width_mm": 24.0}, display={"rows": 300})
    optics = Optics(rig)
    u = np.array([159.5, -6000.0, 159.5, -45.0, 159.5])
    v = np.array([127.5, 127.5, 127.5 + 160, 127.5, 127.5 + 60])
    trace = optics.trace(u, v, Flat())
    misses = 2 * [Lost.MISSES_CAMERA_FACE]
    assert trace.lost.tolist() == [Lost.NONE, *misses, Lost.MISSES_MIRROR, Lost.NONE]
    assert np.isnan(trace.q[1:4]).all()
    # 300 rows of 0.063 mm reach 9.45 mm from y = 0; the view 12 mm
    below = optics.trace(np.array([159.5]), np.array([127.5 + 68]), Flat())
    assert below.lost[0] == Lost.OFF_DISPLAY
    assert below.q[0, 1] > 299.5


def test_a_mirror_turned_too_far_loses_its_ray_by_the_way_it_turns():
    optics = Optics(small())
    u, v = np.array([120.0]), np.array([127.5])
    x, y, _ = optics.trace(u, v, Flat()).point[0]

    def lost(slope_x, slope_y=0.0):
        trace = optics.trace(u, v, Dented(Flat(), Ramp(slope_x, slope_y, x, y)))
        return Lost(int(trace.lost[0])), trace.reflectance[0]

    assert lost(0.05) == (Lost.NONE, 1.0)
    name, reflectance = lost(-0.1)  # 5.7 deg against a margin of 4.8
    assert name == Lost.BELOW_TIR
    assert 0.1 < reflectance < 1.0
    assert lost(0.5)[0] == Lost.MISSES_PATTERN_FACE  # turned by 53 deg, past P0
    assert lost(-0.43)[0] == Lost.NO_REFRACTION  # 46.6 deg on the pattern face, beyond its critical angle


@pytest.mark.parametrize(("angle", "expected"), [(0.0, 0.73), (90.0, 0.54), (None, 0.635)])
def test_the_lcds_polarisation_decides_what_a_dim_mirror_gives(angle, expected):
    """In the plane y = 0 at 45 deg the LCD's angle is that to s: 0.73 and 0.54, as Fresnel has it."""
    optics = Optics(perpendicular(display={"polarisation_deg": angle}, prism={"pattern_angle_deg": 50.0}))
    u, v = np.array([159.5]), np.array([127.5])
    x, y, _ = optics.trace(u, v, Flat()).point[0]
    mirror = Dented(Flat(), Ramp(-np.tan(np.radians(5.0)), 0.0, x, y))
    trace = optics.trace(u, v, mirror)
    assert np.degrees(np.arccos(trace.cos_incidence[0])) == pytest.approx(45.0)
    assert trace.lost[0] == Lost.BELOW_TIR
    assert trace.reflectance[0] == pytest.approx(expected, abs=0.005)  # two printed digits


def test_the_paper_bench_sees_just_below_total_reflection():
    optics = Optics(load_rig("paper"))
    trace = optics.centre()
    assert trace.lost[0] == Lost.BELOW_TIR
    assert 0.5 < trace.reflectance[0] < 0.75


def test_unknown_pixels_and_shapes_pass_through_silently():
    optics = Optics(small())
    u, v = np.full((2, 3, 4), 159.5), np.full((2, 3, 4), 127.5)
    u[1, 2, 3] = np.nan
    trace = optics.trace(u, v, Flat())
    assert trace.q.shape == (2, 3, 4, 2)
    assert trace.lost.dtype == np.uint8
    assert np.isnan(trace.q).sum() == 2
    assert np.isnan(optics.sensitivity(u, v)).sum() == 4
    assert np.isnan(optics.rubber_direction_to_lcd(trace.point, trace.q)).sum() == 3
    np.testing.assert_array_equal(optics.rest_map(u, v), trace.q)
