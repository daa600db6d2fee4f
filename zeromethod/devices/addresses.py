"""Camera addresses, as `--camera` takes them: an index, a URL, a file, a camera kind or a driver's name."""

from __future__ import annotations

import re
from collections.abc import Mapping
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any

from zeromethod.errors import InputError
from zeromethod.rig.model import CameraSpec, Rig

ALLOWED = (
    "an index (0), a URL (tcp://, http://, rtsp://), a video file, pylon[:serial], aravis[:address], "
    "package.module:Name, or an installed driver"
)

_PICKED_BY = {"pylon": "serial", "aravis": "address"}
_URL = re.compile(r"[a-z][a-z0-9+.-]*://.", re.IGNORECASE)
_IMPORT_PATH = re.compile(r"[^\W\d]\w*(\.[^\W\d]\w*)*:[^\W\d]\w*")


def camera_driver(address: str, option: str = "--camera") -> tuple[str, dict[str, Any]]:
    """Driver of an address and the option by which that driver finds the camera.

    Raises InputError, one line with what is allowed. Whether the camera is there shows when it is opened.
    """
    driver, _, which = address.partition(":")
    if address.isdecimal():
        return "opencv", {"source": int(address)}
    if _URL.match(address):
        return "opencv", {"source": address}
    if driver in _PICKED_BY and bool(which) == (":" in address):
        return driver, {_PICKED_BY[driver]: which} if which else {}
    if Path(address).is_file():
        return "opencv", {"source": address}
    if _IMPORT_PATH.fullmatch(address) or address in entry_points(group="zeromethod.cameras").names:
        return address, {}
    raise InputError(f"{option}: {address!r}: allowed: {ALLOWED}")


def with_camera(rig: Rig, address: str, settings: Mapping[str, Any] | None = None) -> Rig:
    """Rig whose camera is the one at `address`, with `settings` (keys of `[camera]`) in place of its own.

    The options of another driver are left out. Raises InputError (one line) for an address or a setting
    that is not allowed.
    """
    driver, options = camera_driver(address)
    return _with_device(rig, "camera", rig.camera, {"driver": driver} | options | dict(settings or {}))


def with_watch_camera(rig: Rig, address: str | None) -> Rig:
    """Rig whose watch camera is the one at `address`; as it is for None.

    Raises InputError (one line) for an address that is not allowed, or a rig without a watch camera.
    """
    if address is None:
        return rig
    if rig.watch is None:
        raise InputError(
            f"--watch-camera: {address!r}: the rig has no table [watch]; allowed: with a rig that says "
            "there where a watch camera is, as the packaged rig contactless does"
        )
    driver, options = camera_driver(address, "--watch-camera")
    return _with_device(rig, "watch", rig.watch, {"driver": driver} | options)


def with_projector(rig: Rig, monitor: int | None, *, real: bool) -> Rig:
    """Rig whose projector is a monitor; as it is for None. real: the LCD is no simulated one.

    Raises InputError (one line) for a rig without a projector.
    """
    if monitor is None:
        return rig
    if rig.projector is None:
        raise InputError(
            f"--project: {monitor}: rig {rig.name!r} has no table [projector]; allowed: with a rig that "
            "says where a projector's picture falls (interactive)"
        )
    return rig.replace({"projector.monitor": monitor} | ({"projector.driver": "window"} if real else {}))


def _with_device(rig: Rig, table: str, spec: CameraSpec, given: Mapping[str, Any]) -> Rig:
    own = (spec.model_extra or {}) if spec.driver == given["driver"] else {}
    try:
        return rig.replace({table: spec.given() | own | dict(given)})
    except InputError as error:
        raise InputError(str(error).removeprefix("rig: ")) from None
