"""The simulated clone of a real bench: what stays, what goes, and that it runs."""

import pytest

from zeromethod.devices.opening import open_devices
from zeromethod.rig.model import CameraSpec, Noise, Rig
from zeromethod.simulation.clone import simulated_clone

DISPLAY = {"driver": "window", "monitor": 1, "latency_s": 0.02, "rise_s": 0.003, "scan": "up", "gamma": 1.9}
CAMERA = {
    "driver": "pylon",
    "serial": "12345",
    "gain": 3.0,
    "pixel_format": "Mono8",
    "region_px": (100, 50, 80, 64),
    "trigger": "hardware",
    "latency_s": 0.011,
    "noise": Noise(read_grey=1.5, electrons_per_grey=40.0, black_grey=3.0),
}


def real(rig: Rig, **more: dict) -> Rig:
    """The rig with the devices of a lab."""
    latency = {"simulation.camera_latency_s": None}
    lab = {"display": rig.display.given() | DISPLAY, "camera": rig.camera.given() | CAMERA}
    changes = {f"{table}.{key}": value for table, keys in more.items() for key, value in keys.items()}
    return rig.replace(lab | latency | changes)


def test_only_what_belongs_to_the_devices_goes(make_rig):
    rig = real(make_rig())
    clone = simulated_clone(rig)
    assert clone.display.driver == clone.camera.driver == "simulated"
    assert not clone.display.model_extra
    assert not clone.camera.model_extra
    gone = {"driver", "gain", "pixel_format", "region_px", "trigger", "rest_map"}
    assert clone.camera.model_dump(exclude=gone) == rig.camera.model_dump(exclude=gone | {"serial"})
    assert clone.display.model_dump(exclude={"driver"}) == rig.display.model_dump(
        exclude={"driver", "monitor"}
    )
    fresh = CameraSpec.model_fields
    for key in gone - {"driver"}:
        assert getattr(clone.camera, key) == fresh[key].default
    others = {"display", "camera", "simulation"}
    assert clone.model_dump(exclude=others) == rig.model_dump(exclude=others)


def test_what_the_rig_file_gave_is_still_what_is_given(make_rig):
    rig = real(make_rig())
    clone = simulated_clone(rig)
    assert clone.camera.model_fields_set == rig.camera.model_fields_set & set(CameraSpec.model_fields) - {
        "gain", "pixel_format", "region_px", "trigger", "rest_map"
    }  # fmt: skip


def test_the_cameras_latency_becomes_the_simulated_ones(make_rig):
    assert simulated_clone(real(make_rig())).simulation.camera_latency_s == 0.011
    given = real(make_rig(), simulation={"camera_latency_s": 0.002})
    assert simulated_clone(given).simulation.camera_latency_s == 0.002


@pytest.mark.parametrize(("display_s", "camera_s", "left_s"), [(-0.004, 0.011, 0.007), (-0.02, 0.011, 0.0)])
def test_a_display_that_seems_to_come_early_does_not(make_rig, display_s, camera_s, left_s):
    rig = real(make_rig(), display={"latency_s": display_s}, camera={"latency_s": camera_s})
    clone = simulated_clone(rig)
    assert clone.display.latency_s == 0.0
    assert clone.camera.latency_s == pytest.approx(left_s)
    assert clone.simulation.camera_latency_s == pytest.approx(left_s)


def test_a_simulated_rig_is_its_own_clone(make_rig):
    rig = make_rig()
    assert simulated_clone(rig) is rig
    clone = simulated_clone(real(rig))
    assert simulated_clone(clone) is clone


def test_the_given_rig_is_left_alone(make_rig):
    rig = real(make_rig())
    before = rig.model_dump()
    simulated_clone(rig)
    assert rig.model_dump() == before


def test_the_clone_opens_and_gives_frames_at_the_real_rate(make_rig):
    clone = simulated_clone(real(make_rig(), camera={"rate_hz": 40.0}))
    with open_devices(clone) as devices:
        frames = [devices.camera.read(1.0) for _ in range(3)]
        arrived_ns = devices.clock.now_ns()
    assert frames[0].image.shape == (64, 80)
    # 0.1 ms of clock jitter on either frame
    assert (frames[2].time_ns - frames[1].time_ns) * 1e-9 == pytest.approx(1 / 40.0, abs=5e-4)
    ended_ns = frames[2].time_ns + frames[2].exposure_ns / 2
    assert (arrived_ns - ended_ns) * 1e-9 == pytest.approx(0.011, abs=1e-6)
