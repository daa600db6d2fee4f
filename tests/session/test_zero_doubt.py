"""A zero taken with a wrong rig that is declared exact: what its rest showed stays in sigma."""

import pytest
from small_rigs import SMALL_LCD, quarter, with_tables

import zeromethod as zm
from zeromethod.devices.opening import open_devices
from zeromethod.rig.geometry import GeometrySpec
from zeromethod.simulation.loads import load
from zeromethod.simulation.path import PathPoint, PressPath
from zeromethod.simulation.scenario import Scenario

DENT = load(42.0, 0.0, 0.1, 4.2)
PRESSED_NS = 600_000_000


def test_a_press_after_a_zero_is_within_sigma_though_the_prism_is_not_as_declared():
    believed = quarter(display=SMALL_LCD, scenario="none", geometry=GeometrySpec(known="exact"))
    path = tuple(PathPoint(PRESSED_NS, DENT.x_mm, DENT.y_mm, depth) for depth in (0.0, DENT.depth_mm))
    with open_devices(with_tables(believed, prism={"pattern_angle_deg": 50.3})) as devices:
        devices.camera.scenario = Scenario("press", (PressPath(DENT, path),), 1e9)
        with zm.Session(believed, devices=devices) as session:
            list(session.run(frames=16))
            session.loop.rezero()
            # until it is learned what presses: a learning of rest may have to end before
            *_, last = session.run(frames=70)
    assert last.state is zm.State.LOCKED
    # 0.3 deg make depth 0.4 % wrong, which without the rest's evidence was four sigma
    assert last.peak.depth_mm == pytest.approx(DENT.depth_mm, abs=2 * last.peak.sigma_mm)
    assert last.peak.sigma_mm < 0.01 * DENT.depth_mm
