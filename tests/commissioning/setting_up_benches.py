"""Small simulated benches that stand otherwise than the rig file says, for setting up by eye."""

from __future__ import annotations

from typing import Any

from zeromethod.commissioning.setting_up import SettingUp, Sight
from zeromethod.devices.opening import open_devices
from zeromethod.rig.binning import binned
from zeromethod.rig.load import load_rig
from zeromethod.rig.model import Rig


def coarse(rig: Rig) -> Rig:
    """The same bench with an eighth of the camera's pixels on each axis and a quarter of the LCD's: quick."""
    lcd = rig.display.model_copy(update={"columns": 480, "rows": 270, "pitch_mm": 4 * rig.display.pitch_mm})
    return binned(rig, 8).model_copy(update={"display": lcd, "scenario": "none"})


RIG = coarse(load_rig("simulated"))
"""As the rig file says: 160 x 128 camera px."""


def planted(**tables: dict[str, Any]) -> Rig:
    """The bench as it truly stands: tables of the rig with other values."""
    return RIG.model_copy(
        update={name: getattr(RIG, name).model_copy(update=values) for name, values in tables.items()}
    )


def look(truth: Rig, seconds: float = 0.01, with_lcd: bool = True) -> Sight:
    """Last sight of a bench that truly stands as `truth`, by one who believes `RIG`."""
    with open_devices(truth) as devices:
        return list(SettingUp(RIG, devices, with_lcd).sights(seconds))[-1]
