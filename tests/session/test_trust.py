"""Whether a session trusts its rig's geometry, and what its readings state where it does not."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from commissioning.calibration import planted

import zeromethod as zm
from zeromethod.devices.opening import Devices, open_devices
from zeromethod.simulation.camera import SimulatedCamera
from zeromethod.simulation.loads import load
from zeromethod.simulation.path import PathPoint, PressPath
from zeromethod.simulation.scenario import Scenario
from zeromethod.warp.rest_map import RestMap

DEPTH_MM = 0.1


def truth() -> zm.Rig:
    """The bench as it is, its delay known."""
    return planted.truth(planted.nominal()).replace({"display.latency_s": 0.0})


@contextmanager
def bench(pressed: bool = False) -> Iterator[Devices]:
    """Devices of the bench as it truly is, a little off what its rig file says."""
    with open_devices(truth()) as devices:
        camera = devices.camera
        assert isinstance(camera, SimulatedCamera)
        points = (PathPoint(0, 38.0, -1.0, 0.0), PathPoint(1, 38.0, -1.0, DEPTH_MM))
        points += (PathPoint(10**12, 38.0, -1.0, DEPTH_MM),)
        dent = load(38.0, -1.0, DEPTH_MM, planted.PAD_MM)
        camera.scenario = Scenario("held", (PressPath(dent, points),) if pressed else (), 1e9)
        yield devices


@pytest.fixture(scope="module")
def rest_map(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The true bench's rest, exact, as fringes would give it."""
    rig = truth()
    v, u = np.indices((rig.camera.rows, rig.camera.columns)).astype(np.float64)
    q = zm.Optics(rig).rest_map(u, v)
    valid = np.isfinite(q).all(axis=-1)
    path = tmp_path_factory.mktemp("rest") / "rest.npz"
    RestMap(q, np.full(q.shape, 0.02), valid, (~valid).astype(np.uint16)).save(path)
    return path


def test_a_press_on_an_uncalibrated_bench_is_relative_and_within_its_sigma(rest_map):
    given = planted.nominal().replace({"camera.rest_map": rest_map})
    with bench(pressed=True) as devices, zm.Session(given, devices=devices) as session:
        steps = list(session.run(frames=24))
    last = steps[-1]
    assert last.state is zm.State.UNCALIBRATED
    assert "zeromethod calibrate" in last.reason
    assert not any(step.calibrated for step in steps)
    assert 0.005 < last.peak.sigma_mm / DEPTH_MM < 0.3
    # everything is off by about a caliper's sigma
    assert abs(last.peak.depth_mm - DEPTH_MM) < 3.0 * last.peak.sigma_mm
    assert abs(last.peak.x_mm - 38.0) < 3.0 * last.peak.sigma_x_mm
    assert abs(last.peak.y_mm + 1.0) < 3.0 * last.peak.sigma_y_mm


def test_without_a_measured_rest_depth_is_known_to_its_size_at_best():
    with bench() as devices, zm.Session(planted.nominal(), devices=devices) as session:
        steps = list(session.run(frames=12))
    assert not {step.state for step in steps} & {zm.State.LOCKED, zm.State.RESTING}
    for step in steps:
        # nothing is read on the way
        assert step.peak is None or step.state is zm.State.UNCALIBRATED
        assert step.peak is None or step.peak.sigma_mm >= abs(step.peak.depth_mm)


def test_an_operator_may_declare_a_geometry_exact():
    given = planted.nominal().replace({"geometry.known": "exact"})
    with bench() as devices, zm.Session(given, devices=devices) as session:
        steps = list(session.run(frames=4))
    assert all(step.calibrated for step in steps)
