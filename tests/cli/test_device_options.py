"""From `--display`, `--camera` and settings to the rig: what is taken over, and every way to be refused."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from zeromethod.cli.device_options import BenchOptions, with_asked_strips, with_devices, with_latency
from zeromethod.drivers.monitors import Monitor
from zeromethod.errors import InputError
from zeromethod.rig.load import load_rig
from zeromethod.rig.model import Rig

RIG = load_rig("simulated")
MONITORS = (
    Monitor(0, "eDP-1", 2560, 1440, 144.0, 0, 0, 1.0, primary=True),
    Monitor(1, "HDMI-1", 1920, 1080, 59.94, 2560, 0, 1.0, primary=False),
    Monitor(2, "DP-2", 1920, 1080, 75.0, 4480, 0, 1.0, primary=False),
)
LISTED = (
    "0 (eDP-1, 2560 x 1440, 144.00 Hz, at 0, 0), 1 (HDMI-1, 1920 x 1080, 59.94 Hz, at 2560, 0), "
    "2 (DP-2, 1920 x 1080, 75.00 Hz, at 4480, 0)"
)


@pytest.fixture(autouse=True)
def _three_monitors(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("zeromethod.drivers.monitors.monitors", lambda: MONITORS)


def made(rig: Rig = RIG, camera_alone: bool = False, **options: Any) -> Rig:
    return with_devices(rig, BenchOptions(**options), camera_alone)


def of(table: str, rig: Rig = RIG, **values: Any) -> Rig:
    """Rig with other values in one of its device tables."""
    spec = getattr(rig, table)
    return rig.model_copy(
        update={table: type(spec).model_validate(spec.model_dump(exclude_unset=True) | values)}
    )


def test_without_options_the_rig_is_as_it_was() -> None:
    assert made() == RIG


def test_a_monitor_and_a_camera_take_the_places_of_the_simulated_ones() -> None:
    rig = made(monitor=1, address="tcp://127.0.0.1:5005")
    assert (rig.display.driver, rig.display.model_extra) == ("window", {"monitor": 1})
    assert (rig.camera.driver, rig.camera.model_extra) == ("opencv", {"source": "tcp://127.0.0.1:5005"})
    # all else stays, the geometry above all
    assert (
        rig.display.model_copy(update={"driver": "simulated", "monitor": None}).pitch_mm
        == RIG.display.pitch_mm
    )
    assert rig.camera.focal_px == RIG.camera.focal_px
    assert (rig.prism, rig.target, rig.control) == (RIG.prism, RIG.target, RIG.control)


def test_settings_of_the_command_line_stand_above_the_rig_files() -> None:
    rig = made(
        of("camera", driver="pylon", gain=1.0, pixel_format="Mono12", serial="400"),
        monitor=1, exposure_s=0.004, gain=6.0, pixel_format="Mono8", region_px=(64, 32, 1280, 1024),
        trigger="software",
    )  # fmt: skip
    camera = rig.camera
    assert (camera.exposure_s, camera.gain, camera.pixel_format) == (0.004, 6.0, "Mono8")
    assert (camera.region_px, camera.trigger) == ((64, 32, 1280, 1024), "software")
    assert camera.model_extra == {"serial": "400"}


def test_the_rig_files_settings_stay_where_only_the_address_is_given() -> None:
    own = of("camera", driver="pylon", gain=1.0, trigger="hardware", serial="400")
    camera = made(own, monitor=1, address="pylon:401").camera
    assert (camera.gain, camera.trigger, camera.model_extra) == (1.0, "hardware", {"serial": "401"})


def test_the_simulated_bench_can_be_exposed_otherwise() -> None:
    assert made(exposure_s=0.002).camera.exposure_s == 0.002


def test_a_rig_files_own_window_moves_to_the_monitor_named() -> None:
    rig = of("camera", of("display", driver="window", monitor=2), driver="opencv", source=0)
    assert made(rig, monitor=1).display.model_extra == {"monitor": 1}
    assert made(rig).display.model_extra == {"monitor": 2}


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"monitor": 5, "address": "0"}, f"--display: 5: no such monitor; allowed: {LISTED}"),
        (
            {"monitor": 0, "address": "0"},
            "--display: 0: set to another mode than the rig's display (1920 x 1080 px at 60 Hz): set the "
            f"monitor or the rig file; monitors: {LISTED}",
        ),
        (
            {"monitor": 2, "address": "0"},
            "--display: 2: set to another mode than the rig's display (1920 x 1080 px at 60 Hz): set the "
            f"monitor or the rig file; monitors: {LISTED}",
        ),
        (
            {"monitor": 1},
            "--display: 1: the simulated camera cannot observe a monitor; allowed: with --camera, or a rig "
            "file with a camera of its own",
        ),
        (
            {"monitor": 1, "address": "simulated"},
            "--display: 1: the simulated camera cannot observe a monitor; allowed: with --camera, or a rig "
            "file with a camera of its own",
        ),
        (
            {"address": "0"},
            "--camera: '0': a camera cannot observe the simulated display; allowed: with --display, or a rig "
            "file with a display of its own",
        ),
        (
            {"monitor": 1, "address": "film.mp4"},
            "--camera: 'film.mp4': allowed: an index (0), a URL (tcp://, http://, rtsp://), a video file, "
            "pylon[:serial], aravis[:address], package.module:Name, or an installed driver",
        ),
        ({"exposure_s": 0.0}, "--exposure: 0.0: a number of seconds above 0"),
        ({"exposure_s": float("nan")}, "--exposure: nan: a number of seconds above 0"),
        ({"exposure_s": 0.02}, "--exposure: 0.02: at most the frame time, 0.0166667"),
        ({"gain": -1.0, "address": "0", "monitor": 1}, "--camera-gain: -1.0: a number from 0 on"),
        ({"gain": 3.0}, "--camera-gain: the simulated camera has none; allowed: with --camera"),
        ({"pixel_format": "Mono8"}, "--pixel-format: the simulated camera has none; allowed: with --camera"),
        ({"trigger": "free"}, "--trigger: the simulated camera has none; allowed: with --camera"),
        (
            {"region_px": (0, 0, 1280, 1024), "address": "simulated"},
            "--region: the simulated camera has none; allowed: with --camera",
        ),
        (
            {"region_px": (0, 0, 640, 512), "address": "pylon", "monitor": 1},
            "--region: [0, 0, 640, 512]: 1280, 1024 (columns, rows) at its end",
        ),
        (
            {"pixel_format": "", "address": "pylon", "monitor": 1},
            '--pixel-format: "": text that is not empty',
        ),
    ],
)  # fmt: skip
def test_what_cannot_be_is_refused_in_one_line(options: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError) as refused:
        made(**options)
    assert str(refused.value) == message


def test_a_rig_files_camera_beside_the_simulated_display_is_refused() -> None:
    rig = of("camera", driver="opencv", source=0)
    with pytest.raises(InputError, match=r"^camera\.driver: 'opencv': a camera cannot observe the simulated"):
        made(rig)
    assert made(rig, camera_alone=True) == rig


def test_without_a_screen_the_reason_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    def none() -> tuple[Monitor, ...]:
        raise InputError("display window: no screen: DISPLAY is not set")

    monkeypatch.setattr("zeromethod.drivers.monitors.monitors", none)
    with pytest.raises(InputError, match=r"^--display: 1: no screen: DISPLAY is not set$"):
        made(monitor=1, address="0")


def test_a_camera_of_ones_own_may_see_the_simulated_display() -> None:
    assert made(address="my_lab:Camera").camera.driver == "my_lab:Camera"


def test_given_options_are_told_as_they_are_typed() -> None:
    options = BenchOptions(monitor=0, gain=0.0, region_px=(0, 0, 1, 1))
    assert options.given == ("--display", "--camera-gain", "--region")
    assert BenchOptions().given == ()
    assert options.settings == {"gain": 0.0, "region_px": (0, 0, 1, 1)}


def test_the_delay_is_taken_within_its_bounds() -> None:
    assert with_latency(RIG, None) is RIG
    assert with_latency(RIG, -0.012).display.latency_s == -0.012
    for wrong in (-1.1, 11.0, float("nan")):
        with pytest.raises(InputError, match=rf"^--latency: {wrong}: from -1 to 10 s$"):
            with_latency(RIG, wrong)


@pytest.mark.parametrize(
    ("rig_says", "told", "named", "strips"),
    [
        (None, None, False, "none"),
        (None, None, True, "edges"),
        ("none", None, True, "none"),
        ("edges", None, False, "edges"),
        ("edges", False, True, "none"),
        ("none", True, False, "edges"),
    ],
)
def test_strips_are_as_told_else_as_the_rig_says_else_with_devices(
    rig_says: str | None, told: bool | None, named: bool, strips: str
) -> None:
    values = RIG.control.model_dump(exclude_unset=True) | ({"strips": rig_says} if rig_says else {})
    rig = RIG.model_copy(update={"control": type(RIG.control).model_validate(values)})
    assert with_asked_strips(rig, told, named).control.strips == strips


def test_a_rig_files_own_camera_is_a_real_device_too() -> None:
    assert with_asked_strips(of("camera", driver="aravis"), None, named=False).control.strips == "edges"


def test_a_video_file_is_taken_by_its_path(tmp_path: Path) -> None:
    film = tmp_path / "film.y4m"
    film.touch()
    assert made(monitor=1, address=str(film)).camera.model_extra == {"source": str(film)}
