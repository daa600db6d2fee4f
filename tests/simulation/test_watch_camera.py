from dataclasses import replace

import numpy as np
import pytest

from zeromethod.clock import HostClock, SimulatedClock
from zeromethod.devices.protocols import CameraLost, CameraTimeout
from zeromethod.devices.watch_camera import watch_opener
from zeromethod.errors import InputError
from zeromethod.rig.load import load_rig
from zeromethod.simulation.contact.objects import Form, Solid
from zeromethod.simulation.contact.path import ObjectPath
from zeromethod.simulation.path import PathPoint, PressPath
from zeromethod.simulation.press import Dent, Shape
from zeromethod.simulation.watch_camera import SimulatedWatchCamera

RIG = load_rig("contactless").replace(scenario="none")


def camera_of(*dents, height_mm=40.0):
    """A ball hangs over a mirror with these dents."""
    camera = SimulatedWatchCamera(RIG, SimulatedClock())
    ball = ObjectPath(Solid(Form.BALL, 6.0, albedo=0.04), (PathPoint(0, 70.0, 0.0, -height_mm),))
    presses = tuple(PressPath(dent, (PathPoint(0, dent.x_mm, dent.y_mm, dent.depth_mm),)) for dent in dents)
    camera.scenario = replace(camera.scenario, objects=(ball,), presses=presses)
    return camera


def middle_of(light):
    """(row, col) of what is dark in the left view's middle."""
    dark = np.where((light[:, :160] > 0.03) & (light[:, :160] < 0.3), 1.0, 0.0)
    rows, cols = np.indices(dark.shape)
    return np.array([(rows * dark).sum(), (cols * dark).sum()]) / dark.sum()


def test_a_dent_displaces_the_picture_of_what_is_behind_it_by_refraction():
    # a prism of angle s turns light by (n - 1) s, n = 1.41: seen a ball's height farther on, against the turn
    dent = Dent(Shape.GAUSSIAN, 70.0, 0.0, 1.0, 12.0)
    rest, pressed = camera_of(), camera_of(dent)
    point, ray = rest._rest
    off = np.linalg.norm(point[:, :160, :2] + 46.0 * (ray / ray[..., 2:])[:, :160, :2] - [70.0, 0.0], axis=-1)
    row, col = np.unravel_index(np.nanargmin(off), off.shape)
    seen_at = point[row, col]
    assert middle_of(rest.light(0.0)) == pytest.approx([row, col], abs=1.0)
    _, _, by_y = dent.field(seen_at[:1], seen_at[1:2])
    moved = middle_of(pressed.light(0.0)) - middle_of(rest.light(0.0))
    # on the mirror, mm: over the ball's height, along y as columns go; 0.47 mm a pixel there
    expected_px = 0.41 * float(by_y[0]) * 46.0 / (0.47 * (1 + 46.0 / 128.0))
    assert abs(moved[1]) > 0.3
    # the lever of the lens and the slope change over the ball: a fifth
    assert moved[1] == pytest.approx(expected_px, rel=0.2)


def test_nearer_is_larger_by_the_distance_from_the_lens():
    areas = [np.sum(camera_of(height_mm=h).light(0.0)[:, :160] < 0.33) for h in (20.0, 80.0)]
    empty = np.sum(camera_of(height_mm=5000.0).light(0.0)[:, :160] < 0.33)
    ratio = np.sqrt((areas[0] - empty) / (areas[1] - empty))
    # lens 128 mm (across) and 181 mm (along) below the mirror in air, the ball's middle 6 mm up
    expected = np.sqrt((86 + 128) * (86 + 181) / ((26 + 128) * (26 + 181)))
    assert ratio == pytest.approx(expected, rel=0.04)  # of 300 pixels, counted whole


def test_only_frames_in_hand_are_read_and_the_clock_stays():
    clock = SimulatedClock()
    camera = SimulatedWatchCamera(RIG, clock)
    clock.sleep_until_ns(120_000_000)
    frame = camera.read(0.0)
    assert (frame.number, frame.time_ns) == (3, 100_000_000)
    with pytest.raises(CameraTimeout):
        camera.read(1.0)
    assert clock.now_ns() == 120_000_000
    gone = RIG.replace({"simulation.faults.watch": "lost", "simulation.faults.watch_s": [0.0, 1.0]})
    with pytest.raises(CameraLost):
        SimulatedWatchCamera(gone, clock)


def test_a_simulated_watch_camera_beside_a_real_camera_is_refused():
    real = RIG.replace({"camera.driver": "opencv"})
    with pytest.raises(InputError, match=r"watch\.driver: 'simulated'.*--watch-camera together with"):
        watch_opener(real, HostClock())
