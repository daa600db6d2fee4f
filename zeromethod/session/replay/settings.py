"""Other settings for a rig that is at hand: `control.gain=0.5`, as the rig file would say it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from zeromethod.errors import InputError
from zeromethod.rig.model import Rig, replaced
from zeromethod.toml_file import parse_toml


def with_settings(rig: Rig, settings: Sequence[str]) -> Rig:
    """Rig with each "key=value" in place of its own: dotted keys of a rig file, values as TOML writes them.

    Text may go without quotes. Raises InputError, one line, for what is no such pair, an unknown key or a
    value that is not allowed.
    """
    values: dict[str, Any] = {}
    for setting in settings:
        key, equals, text = setting.partition("=")
        if not equals or not key.strip():
            raise InputError(f"--set: {setting!r}: key=value, as control.gain=0.5")
        values[key.strip()] = _value(text.strip())
    return replaced(rig, values, "--set") if values else rig


def _value(text: str) -> Any:
    try:
        return parse_toml(f"value = {text}", "--set")["value"]
    except InputError:
        return text
