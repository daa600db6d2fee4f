"""Other settings for a rig that is at hand: `control.gain=0.5`, as the rig file would say it."""

from __future__ import annotations

import json
import re
import tomllib
from collections.abc import Sequence
from typing import Any

from pydantic import ValidationError

from zeromethod.errors import InputError
from zeromethod.rig.model import Rig
from zeromethod.rig.refusal import first_refusal

_STEP = re.compile(r"([A-Za-z0-9_-]+)|\[(\d+)\]")


def with_settings(rig: Rig, settings: Sequence[str]) -> Rig:
    """Rig with each "key=value" in place of its own: dotted keys of a rig file, values as TOML writes them.

    Text may go without quotes. Raises InputError, one line, for what is no such pair, an unknown key or a
    value that is not allowed.
    """
    if not settings:
        return rig
    data: dict[str, Any] = rig.model_dump(mode="json", exclude_unset=True)
    for setting in settings:
        key, equals, text = setting.partition("=")
        if not equals or not key.strip():
            raise InputError(f"--set: {setting!r}: key=value, as control.gain=0.5")
        try:
            _put(data, key.strip(), _value(text.strip()))
        except (KeyError, IndexError, TypeError):
            raise InputError(f"--set: {key.strip()}: no such key of a rig file") from None
    try:
        return Rig.model_validate_json(json.dumps(data), strict=True)
    except ValidationError as error:
        raise InputError(f"--set: {first_refusal(error, Rig)}") from None


def _value(text: str) -> Any:
    try:
        return tomllib.loads(f"value = {text}")["value"]
    except tomllib.TOMLDecodeError:
        return text


def _put(data: dict[str, Any], key: str, value: Any) -> None:
    steps = [int(index) if index else name for name, index in _STEP.findall(key)]
    table: Any = data
    for step in steps[:-1]:
        if isinstance(step, str) and isinstance(table, dict):
            table = table.setdefault(step, {})
        else:
            table = table[step]
    table[steps[-1]] = value
