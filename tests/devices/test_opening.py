from typing import Any

import numpy as np
import pytest

from zeromethod import InputError, binned, load_rig
from zeromethod.clock import HostClock, SimulatedClock
from zeromethod.devices import opening
from zeromethod.devices.opening import load_driver, open_devices
from zeromethod.devices.protocols import CameraLost, Frame
from zeromethod.rig.model import CameraSpec, DisplaySpec, Rig

RIG = binned(load_rig("simulated"), 8)
LOG: list[str] = []


class PlainDisplay:
    """A display with an option of its own and one key of the rig's schema."""

    refresh_hz = 60.0

    def __init__(self, columns: int, rows: int, monitor: int = 0) -> None:
        LOG.append(f"display opened on {monitor}")
        self.size = (columns, rows)

    def show(self, image: np.ndarray) -> int:
        return 0

    def close(self) -> None:
        LOG.append("display closed")


class PlainCamera:
    shape = (RIG.camera.rows, RIG.camera.columns)
    bits = 8

    def __init__(self, display: object, rate_hz: float, serial: str = "") -> None:
        LOG.append(f"camera {serial} opened at {rate_hz}")
        self.display = display

    def read(self, timeout_s: float) -> Frame:
        raise NotImplementedError

    def close(self) -> None:
        LOG.append("camera closed")


class ClockedDisplay(PlainDisplay):
    def __init__(self, rig: Rig, clock: object) -> None:
        super().__init__(rig.display.columns, rig.display.rows)
        self.clock = clock


class ClockedCamera(PlainCamera):
    def __init__(self, rig: Rig, clock: object, display: object) -> None:
        super().__init__(display, rig.camera.rate_hz)
        self.clock = clock


class GreedyCamera(PlainCamera):
    def __init__(self, **options: Any) -> None:
        super().__init__(None, options["rate_hz"])
        self.options = options


class NeedyCamera(PlainCamera):
    def __init__(self, serial: str) -> None:
        raise AssertionError


class SmallDisplay(PlainDisplay):
    def __init__(self) -> None:
        super().__init__(10, 10)


class SmallCamera(PlainCamera):
    shape = (10, 10)


class DeepCamera(PlainCamera):
    bits = 12


class AbsentCamera(PlainCamera):
    def __init__(self) -> None:
        raise CameraLost("no such device\non this bus")


class UnsetCamera(PlainCamera):
    def __init__(self) -> None:
        raise KeyError("LAB_SCRIPT")


class ExitingCamera(PlainCamera):
    def __init__(self) -> None:
        raise SystemExit(3)


class NoCamera:
    shape = (1, 1)


@pytest.fixture(autouse=True)
def _forget() -> None:
    LOG.clear()


def rig(
    camera: str = "PlainCamera",
    display: str = "PlainDisplay",
    camera_keys: dict[str, Any] | None = None,
    display_keys: dict[str, Any] | None = None,
) -> Rig:
    """The rig with drivers from this file."""
    cameras = RIG.camera.model_dump() | {"driver": f"{__name__}:{camera}"} | (camera_keys or {})
    displays = RIG.display.model_dump() | {"driver": f"{__name__}:{display}"} | (display_keys or {})
    return RIG.model_copy(update={"camera": CameraSpec(**cameras), "display": DisplaySpec(**displays)})


def test_display_opens_first_and_closes_last():
    with open_devices(rig()) as devices:
        assert devices.camera.display is devices.display  # type: ignore[attr-defined]
    assert LOG == ["display opened on 0", "camera  opened at 60.0", "camera closed", "display closed"]


def test_extra_keys_reach_the_driver_that_names_them():
    with open_devices(rig(camera_keys={"serial": "X7"}, display_keys={"monitor": 1})):
        assert LOG == ["display opened on 1", "camera X7 opened at 60.0"]


def test_an_option_that_the_driver_does_not_have_is_refused_with_those_it_has():
    with pytest.raises(InputError, match=r"^camera.serail: 'X7': unknown option .* rate_hz, serial$"):
        open_devices(rig(camera_keys={"serail": "X7"}))


def test_a_driver_that_takes_anything_gets_the_keys_of_its_table_and_the_clock():
    given = {"exposure_s": 0.004, "rate_hz": 50.0, "serial": "X7"}
    camera = CameraSpec.model_construct(
        _fields_set={"driver", "exposure_s", "rate_hz"},
        **(RIG.camera.model_dump() | {"driver": f"{__name__}:GreedyCamera"} | given),
    )
    object.__setattr__(camera, "__pydantic_extra__", {"serial": "X7"})
    with open_devices(rig().model_copy(update={"camera": camera})) as devices:
        options = devices.camera.options  # type: ignore[attr-defined]
    assert {key: options[key] for key in given} == given
    assert set(options) == {*given, "clock"}


@pytest.mark.parametrize("keys", [{"gain": 2.0}, {"trigger": "software"}, {"pixel_format": "Mono8"}])
def test_a_setting_that_the_driver_would_not_apply_is_refused(keys):
    (name,) = keys
    with pytest.raises(InputError, match=rf"^camera\.{name}: .*: driver '.*' cannot set it$"):
        open_devices(rig(camera_keys=keys))
    with open_devices(rig("GreedyCamera", camera_keys=keys)) as devices:
        assert devices.camera.options[name] == keys[name]  # type: ignore[attr-defined]


def test_a_missing_option_is_named():
    with pytest.raises(InputError, match=r"^camera.serial: missing"):
        open_devices(rig("NeedyCamera"))


def test_devices_that_take_a_clock_share_a_simulated_one():
    with open_devices(rig("ClockedCamera", "ClockedDisplay")) as devices:
        assert isinstance(devices.clock, SimulatedClock)
        assert devices.camera.clock is devices.display.clock is devices.clock  # type: ignore[attr-defined]


@pytest.mark.parametrize(
    ("camera", "display"), [("PlainCamera", "ClockedDisplay"), ("ClockedCamera", "PlainDisplay")]
)
def test_one_device_in_host_time_puts_the_run_in_host_time(camera, display):
    with open_devices(rig(camera, display)) as devices:
        assert isinstance(devices.clock, HostClock)


def test_a_clock_that_is_given_wins():
    clock = SimulatedClock(7)
    with open_devices(rig(), clock) as devices:
        assert devices.clock is clock


@pytest.mark.parametrize(
    ("camera", "message"),
    [
        ("SmallCamera", r"^camera: the device's frames are \(10, 10\)"),
        ("DeepCamera", "^camera.bits: the device gives 12; the rig says 8"),
        ("AbsentCamera", "cannot be opened: no such device on this bus$"),
        ("UnsetCamera", "cannot be opened: KeyError: 'LAB_SCRIPT'$"),
        ("ExitingCamera", "cannot be opened: SystemExit: 3$"),
        ("NoCamera", "not a camera: lacks bits, read, close"),
    ],
)
def test_a_camera_that_will_not_do_is_refused_and_the_display_closed(camera, message):
    with pytest.raises(InputError, match=message) as error:
        open_devices(rig(camera))
    assert "\n" not in str(error.value)
    assert LOG[-1] == "display closed"


def test_a_display_of_another_size_is_refused():
    with pytest.raises(InputError, match=r"^display: the device's size is \(10, 10\)"):
        open_devices(rig(display="SmallDisplay"))
    assert LOG[-1] == "display closed"


def test_the_camera_can_be_opened_again():
    devices = open_devices(rig())
    first = devices.camera
    assert devices.reopen_camera() is devices.camera is not first
    devices.close()
    assert LOG.count("camera closed") == 2


@pytest.mark.parametrize(
    ("kind", "name", "message"),
    [
        ("camera", "pylno", r"^camera.driver: 'pylno': unknown; allowed: .*simulated"),
        ("display", "no_such_package.module:Name", "cannot be imported"),
        ("display", f"{__name__}:Nothing", r"^display.driver: '.*:Nothing': cannot be imported"),
        ("display", ":", "cannot be imported"),
        ("display", "json:", "cannot be imported"),
        ("display", f"{__name__}:LOG", "not callable"),
    ],
)
def test_names_that_are_no_driver_are_refused(kind, name, message):
    with pytest.raises(InputError, match=message):
        load_driver(kind, name)


def test_a_package_in_the_working_directory_has_drivers(tmp_path, monkeypatch):
    (tmp_path / "lab_for_test").mkdir()
    (tmp_path / "lab_for_test" / "cameras.py").write_text("class Ours:\n    pass\n")
    (tmp_path / "broken_lab.py").write_text("raise RuntimeError('sdk\\nnot found')\n")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(opening.sys, "path", list(opening.sys.path))
    assert load_driver("camera", "lab_for_test.cameras:Ours").__name__ == "Ours"
    with pytest.raises(InputError, match=r"cannot be imported: sdk not found$"):
        load_driver("camera", "broken_lab:Camera")
