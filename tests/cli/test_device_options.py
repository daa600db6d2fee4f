"""From `--display`, `--camera` and settings to the rig: what is taken over."""

from pathlib import Path

import pytest

from zeromethod import InputError, load_rig
from zeromethod.cli.device_options import BenchOptions, with_devices, with_given
from zeromethod.drivers.monitors import Monitor

RIG = load_rig("simulated")
MONITORS = (
    Monitor(0, "eDP-1", 2560, 1440, 144.0, 0, 0, 1.0, primary=True),
    Monitor(1, "HDMI-1", 1920, 1080, 59.94, 2560, 0, 1.0, primary=False),
    Monitor(2, "DP-2", 1920, 1080, 75.0, 4480, 0, 1.0, primary=False),
)


@pytest.fixture(autouse=True)
def _three_monitors(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("zeromethod.drivers.monitors.monitors", lambda: MONITORS)


OPENCV = {"camera.driver": "opencv", "camera.source": 0}
PYLON = {"camera.driver": "pylon", "camera.gain": 1.0, "camera.trigger": "hardware", "camera.serial": "400"}
WINDOW_2 = {"display.driver": "window", "display.monitor": 2}
ON_1 = {"display.driver": "window", "display.monitor": 1}
STREAM = "tcp://127.0.0.1:5005"
GIVEN = {"exposure_s": 0.004, "gain": 6.0, "pixel_format": "Mono8", "region_px": (64, 32, 1280, 1024)}


@pytest.mark.parametrize(
    ("own", "options", "changed"),
    [
        ({}, {}, {}),
        ({}, {"monitor": 1, "address": STREAM}, ON_1 | {"camera.driver": "opencv", "camera.source": STREAM}),
        # settings of the command line win over those of the file, which stay where none are given
        (PYLON, {"monitor": 1, **GIVEN}, ON_1 | {f"camera.{key}": value for key, value in GIVEN.items()}),
        (PYLON, {"monitor": 1, "trigger": "software"}, ON_1 | {"camera.trigger": "software"}),
        (PYLON, {"monitor": 1, "address": "pylon:401"}, ON_1 | {"camera.serial": "401"}),
        ({}, {"exposure_s": 0.002}, {"camera.exposure_s": 0.002}),
        (WINDOW_2 | OPENCV, {"monitor": 1}, ON_1),
        (WINDOW_2 | OPENCV, {}, {}),
        (OPENCV, {"camera_alone": True}, {}),
        # a camera of one's own may see the simulated display
        ({}, {"address": "my_lab:Camera"}, {"camera.driver": "my_lab:Camera"}),
        ({}, {"monitor": 1, "address": "a.y4m"}, ON_1 | OPENCV | {"camera.source": "a.y4m"}),
    ],
)  # fmt: skip
def test_options_take_the_place_of_what_the_rig_says_and_of_nothing_else(
    own, options, changed,
    tmp_path, monkeypatch
):  # fmt: skip
    monkeypatch.chdir(tmp_path)
    Path("a.y4m").touch()
    rig, alone = RIG.replace(own), options.get("camera_alone", False)
    given = BenchOptions(**{key: value for key, value in options.items() if key != "camera_alone"})
    assert with_devices(rig, given, camera_alone=alone) == rig.replace(changed)


def test_without_a_screen_the_reason_is_given(monkeypatch):
    def none() -> tuple[Monitor, ...]:
        raise InputError("display window: no screen: DISPLAY is not set")

    monkeypatch.setattr("zeromethod.drivers.monitors.monitors", none)
    with pytest.raises(InputError, match=r"^--display: 1: no screen: DISPLAY is not set$"):
        with_devices(RIG, BenchOptions(monitor=1, address="0"))


@pytest.mark.parametrize(
    ("own", "coded"),
    [
        ({}, False),
        ({"control.strips": "none", "display.driver": "window"}, False),
        ({"control.strips": "edges"}, True),
        ({"camera.driver": "aravis"}, True),
        ({"camera.driver": "somebody.elses:Camera"}, True),
        ({"display.driver": "somebody.elses:Display"}, True),
    ],
)
def test_strips_are_as_the_rig_says_else_with_any_device_that_is_not_simulated(own, coded):
    assert RIG.replace(own).coded == coded


def test_options_that_were_given_take_the_place_of_the_rigs_values():
    assert with_given(RIG, None, display={"latency_s": None}, control={"gain": None}) == RIG
    rig = with_given(RIG, "step", display={"latency_s": -0.012}, simulation={"seed": 7})
    assert rig == RIG.replace({"scenario": "step", "display.latency_s": -0.012, "simulation.seed": 7})
