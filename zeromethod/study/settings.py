"""Settings by dotted key, put into a rig and a press."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from zeromethod.design.vary import NAMES, varied
from zeromethod.errors import InputError
from zeromethod.rig.binning import binned
from zeromethod.rig.model import Rig, replaced
from zeromethod.rig.refusal import first_refusal
from zeromethod.study.task import StudyPress


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
        rig = replaced(rig, dotted, where, where.parent)
    try:
        return binned(rig, binning) if binning != 1 else rig
    except InputError as error:
        raise InputError(f"{where}: rig.{error}") from None


def press_with(table: Mapping[str, Any], settings: Mapping[str, Any], where: Path) -> StudyPress:
    """Press with values of `settings` ("depth_mm", ...) in place of its own; InputError as above."""
    try:
        return StudyPress.model_validate_json(json.dumps({**table, **settings}, default=str), strict=True)
    except ValidationError as error:
        raise InputError(f"{where}: press.{first_refusal(error, StudyPress)}") from None
