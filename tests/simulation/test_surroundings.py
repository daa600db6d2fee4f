"""Light from around the prism against closed forms: an unfolded prism is a slab with parallel faces."""

import numpy as np
import pytest
from scipy.integrate import quad

from zeromethod.clock import SimulatedClock
from zeromethod.rig.load import load_rig
from zeromethod.rig.model import LightSpec
from zeromethod.simulation.camera import SimulatedCamera
from zeromethod.simulation.display import SimulatedDisplay
from zeromethod.simulation.press import Dent, Mirror, Shape
from zeromethod.simulation.surroundings import (
    CLOUDED,
    SUN_PER_MINUTE,
    Surroundings,
    interface_share,
    room_level,
)

RIG = load_rig("simulated")
FRONT = (0.41 / 2.41) ** 2
"""Of a face from air to rubber of index 1.41, at its normal."""
BACK = FRONT + 0.2**2
"""Of the pattern face, and of the LCD's glass behind the gap."""
AIR_MM = 280.0
FOCAL_PX = 9000.0
REST = Mirror()


def edges(line, level):
    """Where a line of light passes a level, in px with parts of them."""
    above = line > level
    at = np.flatnonzero(above[1:] != above[:-1])
    return at + (level - line[at]) / (line[at + 1] - line[at])


def seen(mirror=REST, **light):
    return Surroundings(RIG.replace({f"light.{key}": value for key, value in light.items()})).seen(mirror)


def test_the_camera_face_shows_the_ring_as_a_mirror_at_its_distance_would():
    line = seen(ring=1.0).ring[512]
    outer = edges(line, FRONT / 2)
    # radius x focal length / twice the way; half a pixel: the view's middle lies between two
    assert outer[-1] - outer[0] == pytest.approx(2 * 30 * FOCAL_PX / (2 * AIR_MM), abs=0.7)


def test_the_mirror_shows_the_ring_further_away_by_the_rubber_over_its_index():
    line = seen(ring=1.0, ring_mm=[25.0, 30.0]).ring[512]
    rubber_mm = 60 * np.sin(np.radians(100))  # twice the mirror's length times the sine of half an apex
    reduced_mm = AIR_MM + rubber_mm / 1.41
    outer = edges(line, FRONT + BACK / 2)
    # there both images overlap; rays are up to 70 mrad from the axis
    assert outer[-1] - outer[0] == pytest.approx(2 * 30 * FOCAL_PX / (2 * reduced_mm), abs=1.5)


def test_a_tilted_mirror_moves_the_image_in_it_alone(tmp_path):
    """Where a ray comes back into itself it meets the pattern face at its normal: 2 n s off the axis."""
    slope, pitch_mm = 8e-3, 1.0
    x = np.arange(-5, 85) * pitch_mm
    np.save(tmp_path / "tilt.npy", np.tile(slope * (x - 42.0), (90, 1)))
    rest = {"shape": "map", "file": tmp_path / "tilt.npy", "pitch_mm": pitch_mm, "origin_mm": [-5.0, -45.0]}
    rig = RIG.replace({"prism.rest": rest, "light.ring": 1.0, "light.ring_mm": [2.0, 4.0]})
    line = Surroundings(rig).seen(Mirror()).ring[512]
    middle = 639.5
    by_face = edges(line[560:720], FRONT / 2) + 560
    assert by_face.mean() == pytest.approx(middle, abs=0.3)
    line[560:720] = 0.0
    by_mirror = edges(line, BACK / 2)
    # 11 mrad of tilt in the rubber: parallel rays are a percent off
    assert abs(by_mirror.mean() - middle) == pytest.approx(2 * 1.41 * slope * FOCAL_PX, rel=0.02)


def test_a_room_all_round_is_seen_by_the_faces_and_where_the_mirror_lets_light_through():
    room = seen(room=1.0).room
    middle = room[:, 300:1000]
    assert middle == pytest.approx(FRONT + BACK, rel=1e-4)
    steep = Mirror((Dent(Shape.CONE, 42.0, 0.0, 1.5, 6.0),))
    surroundings = Surroundings(RIG.replace({"light.room": 1.0, "simulation.renderer": "gpu"}))
    found = surroundings.seen(steep).room
    display = SimulatedDisplay(RIG, SimulatedClock())
    reflected = display.renderer.ray_map(steep)[1]
    display.close()
    inside = np.zeros(found.shape, bool)
    inside[4:-4, 300:1000] = reflected[4:-4, 300:1000] > 0
    partly = inside & (reflected < 0.9)
    assert np.count_nonzero(partly) > 1000
    # what is not reflected is the room itself; rays every four pixels, the shader's own Fresnel
    off = found - (FRONT + 1 - reflected)
    assert np.quantile(np.abs(off[partly]), 0.9) < BACK + 0.02


def test_an_object_that_touches_shades_the_room():
    touch = Mirror((Dent(Shape.BALL, 42.0, 0.0, 0.1, 40.0, contact_mm=2.0, touch_reflectance=0.0),))
    room = seen(touch, room=1.0).room
    assert room[512, 640] == pytest.approx(FRONT, rel=1e-4)
    assert room[512, 300] == pytest.approx(FRONT + BACK, rel=1e-4)


def test_layers_on_a_face_reflect_at_each_of_their_sides():
    assert interface_share([1.0, 1.41]) == pytest.approx(FRONT)
    assert interface_share([1.0, 1.5, 1.41]) == pytest.approx(0.04 + (0.09 / 2.91) ** 2)


def test_clouds_and_lamps_change_the_room_as_they_are_set():
    light = LightSpec(room=0.1, mains=0.2, mains_hz=120.0, sun=3.0, cloud_s=4.0)
    lamps = quad(lambda t: 0.2 * (1 + np.cos(2 * np.pi * 120 * t)), 0.0, 0.003)[0] / 0.003
    assert room_level(light, 0, 3_000_000) == pytest.approx(0.1 + 3.0 + lamps, rel=1e-5)
    sunny, cloudy = (room_level(LightSpec(sun=3.0, cloud_s=4.0), ns, ns) for ns in (0, 2_000_000_000))
    assert cloudy / sunny == pytest.approx(CLOUDED * (1 + SUN_PER_MINUTE * 2 / 60))


@pytest.mark.parametrize("renderer", ["numpy", "gpu"])
def test_frames_have_the_light_of_room_and_lcd(make_rig, renderer):
    """In 16 bits without noise: what the surroundings add, and the LCD's share at another brightness."""
    quiet = {"camera.noise.read_grey": 0.0, "camera.noise.electrons_per_grey": None, "camera.bits": 16}
    plain = make_rig(simulation={"camera_jitter_s": 0.0}).replace({**quiet, "simulation.renderer": renderer})
    lit = plain.replace({"light.room": 0.5, "light.brightness": 0.5})
    black = plain.camera.noise.black_grey
    peak = plain.simulation.peak_grey_share * (2**16 - 1) - black

    def light(rig):
        clock = SimulatedClock()
        display = SimulatedDisplay(rig, clock)
        image = SimulatedCamera(rig, clock, display).read(1.0).image
        display.close()
        return (image - black) / peak

    expected = 0.5 * light(plain) + 0.5 * Surroundings(lit).seen(Mirror()).room
    assert np.abs(light(lit) - expected).max() < 3e-5
