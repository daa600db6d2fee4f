"""Settings by dotted key, put into a rig and a press."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import tomlkit
from pydantic import ValidationError

from zeromethod.design.vary import NAMES, varied
from zeromethod.errors import InputError
from zeromethod.rig.binning import binned
from zeromethod.rig.load import parse_rig
from zeromethod.rig.model import Rig
from zeromethod.rig.refusal import first_refusal, shown
from zeromethod.study.task import PressTable

_STEP = re.compile(r"([A-Za-z0-9_-]+)|\[(\d+)\]")


def with_settings(rig: Rig, settings: Mapping[str, Any], binning: int, where: Path) -> Rig:
    """Rig with values at dotted keys ("control.gain", "pattern_layers[0].thickness_mm"), then binned.

    The words of `zeromethod.design.vary.NAMES` ("angle", "gap", ...) move what goes along with them. Keys are
    those of the camera before binning. Raises InputError, one line that begins with `where`.
    """
    try:
        for key in settings.keys() & NAMES.keys():
            rig = varied(rig, key, float(settings[key]))
    except (InputError, TypeError, ValueError) as error:
        raise InputError(f"{where}: {error}") from None
    dotted = {key: value for key, value in settings.items() if key not in NAMES}
    if dotted:
        data = _without_none(rig.model_dump(mode="json", exclude_unset=True))
        for key, value in dotted.items():
            _set(data, key, value, where)
        rig = parse_rig(tomlkit.dumps(data), where)
    try:
        return binned(rig, binning) if binning != 1 else rig
    except InputError as error:
        raise InputError(f"{where}: rig.{error}") from None


def press_with(table: Mapping[str, Any], settings: Mapping[str, Any], where: Path) -> PressTable:
    """Press with values of `settings` ("depth_mm", ...) in place of its own; InputError as above."""
    try:
        return PressTable.model_validate_json(json.dumps({**table, **settings}, default=str), strict=True)
    except ValidationError as error:
        raise InputError(f"{where}: press.{first_refusal(error, PressTable)}") from None


def _set(data: dict[str, Any], key: str, value: Any, where: Path) -> None:
    steps = [int(index) if index else name for name, index in _STEP.findall(key)]
    place: Any = data
    try:
        for step in steps[:-1]:
            if isinstance(place, dict) and step not in place:
                place[step] = {}
            place = place[step]
        place[steps[-1]] = value
    except (KeyError, IndexError, TypeError):
        raise InputError(f"{where}: {key}: {shown(value)}: a dotted key of a rig file") from None


def _without_none(value: Any) -> Any:
    """The same without what TOML cannot say."""
    if isinstance(value, dict):
        return {key: _without_none(item) for key, item in value.items() if item is not None}
    return [_without_none(item) for item in value] if isinstance(value, list) else value
