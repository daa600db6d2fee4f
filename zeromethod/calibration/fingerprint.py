"""Which bench a calibration belongs to: camera, LCD, pattern and exposure, by name and number."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from zeromethod.devices.abilities import identity_of, name_of
from zeromethod.rig.model import Rig

Fingerprint = dict[str, dict[str, Any]]
"""Tables "camera", "display", "pattern" of plain values, as TOML holds them; without what is not known."""

WORDS = {
    "camera.driver": "camera driver",
    "camera.serial": "camera serial number",
    "camera.model": "camera model",
    "camera.columns": "camera columns",
    "camera.rows": "camera rows",
    "camera.bits": "camera bits",
    "camera.exposure_s": "exposure, s",
    "camera.gain": "camera gain",
    "camera.pixel_format": "pixel format",
    "camera.region_px": "part of the camera's sensor",
    "display.driver": "LCD driver",
    "display.name": "LCD name",
    "display.columns": "LCD columns",
    "display.rows": "LCD rows",
    "display.pitch_mm": "LCD pitch, mm",
    "display.refresh_hz": "LCD refresh rate, Hz",
    "display.scan": "LCD scan direction",
    "pattern.kind": "pattern",
    "pattern.period_px": "period of the pattern, camera px",
    "pattern.mean": "mean light of the pattern",
    "pattern.contrast": "contrast of the pattern",
}
"""Every entry, in words."""

_ALIKE = 1e-3
OF_DEVICES = ("camera.serial", "camera.model", "display.name")
"""Entries that devices say of themselves; all others are the rig's."""


def take_fingerprint(rig: Rig, camera: object = None, display: object = None) -> Fingerprint:
    """Fingerprint of a rig, with what its open devices say of themselves.

    A camera's `serial` and `model` and a display's `name` count where they are text; else the camera's
    `serial` that the rig file asks for.
    """
    asked = str((rig.camera.model_extra or {}).get("serial", ""))
    tables: Fingerprint = {"camera": {}, "display": {}, "pattern": {}}
    specs = {"camera": rig.camera, "display": rig.display, "pattern": rig.target}
    serial, model = identity_of(camera)
    own = {"camera.serial": serial, "camera.model": model, "display.name": name_of(display)}
    for key in WORDS:
        table, name = key.split(".")
        value = own[key] if key in own else getattr(specs[table], name)
        value = value or asked if key == "camera.serial" else value
        if value not in (None, ""):
            tables[table][name] = list(value) if isinstance(value, tuple) else value
    return tables


def check(
    fingerprint: Mapping[str, Mapping[str, Any]], rig: Rig, camera: object = None, display: object = None
) -> list[str]:
    """Differences between a calibration's fingerprint and a bench as it is now, one line each; none: it fits.

    Only what both know is compared.
    """
    now = take_fingerprint(rig, camera, display)
    found = []
    for key, words in WORDS.items():
        table, name = key.split(".")
        before, present = fingerprint.get(table, {}).get(name), now.get(table, {}).get(name)
        if before is not None and present is not None and not _alike(before, present):
            found.append(f"{words}: calibrated with {_shown(before)}, now {_shown(present)}")
    return found


def _alike(before: Any, now: Any) -> bool:
    if isinstance(before, float | int) and isinstance(now, float | int):
        return math.isclose(before, now, rel_tol=_ALIKE)
    return bool(before == now)


def _shown(value: Any) -> str:
    return f"{value:g}" if isinstance(value, float) else str(value)
