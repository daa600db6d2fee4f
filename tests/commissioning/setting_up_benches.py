"""Small simulated benches that stand otherwise than the rig file says, and their devices altered."""

from collections.abc import Callable
from typing import Any

from small_rigs import with_tables

from zeromethod import Rig, binned, load_rig, open_devices
from zeromethod.commissioning.setting_up import SettingUp, Sight


def coarse(rig: Rig, camera: int = 8, lcd: int = 4) -> Rig:
    """The same bench with fewer pixels on each axis, of camera and LCD, by these factors: quick."""
    of_lcd = rig.display
    small = {"columns": of_lcd.columns // lcd, "rows": of_lcd.rows // lcd, "pitch_mm": lcd * of_lcd.pitch_mm}
    return with_tables(binned(rig, camera), display=small, scenario="none")


RIG = coarse(load_rig("simulated"))
"""As the rig file says: 160 x 128 camera px."""

SMALL_RIG = coarse(load_rig("simulated"), 16, 8)
"""The same bench with 80 x 64 camera px."""


def planted(**tables: dict[str, Any]) -> Rig:
    """The bench as it truly stands: tables of `RIG` with other values."""
    return with_tables(RIG, **tables)


def look(truth: Rig, seconds: float = 0.01, with_lcd: bool = True) -> Sight:
    """Last sight of a bench that truly stands as `truth`, by one who believes `RIG`."""
    with open_devices(truth) as devices:
        return list(SettingUp(RIG, devices, with_lcd).sights(seconds))[-1]


class Altered:
    """A device some of whose methods are others."""

    def __init__(self, device: Any, **methods: Callable[..., Any]) -> None:
        self.device = device
        vars(self).update(methods)

    def __getattr__(self, name: str) -> Any:
        return getattr(self.device, name)


def failing(error: Exception) -> Callable[..., Any]:
    """A method that raises."""

    def fail(*_: object) -> None:
        raise error

    return fail
