"""The cameras that are connected, and what to install to find more."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

from zeromethod.devices.contract import RAISED
from zeromethod.drivers import aravis_camera, pylon_camera
from zeromethod.drivers.aravis_library import INSTALL, library
from zeromethod.errors import InputError
from zeromethod.worker import call_within

_VIDEO = Path("/sys/class/video4linux")
PATIENCE_S = 5.0
"""How long a maker's library is waited for."""


@dataclass(frozen=True)
class Found:
    """A camera. address: as `--camera` takes it; name: its own, or why nothing could be listed."""

    address: str
    name: str


@dataclass(frozen=True)
class Missing:
    """A driver that cannot be used here: its name, the cameras it would add, and how to get it."""

    driver: str
    adds: str
    install: str


@dataclass(frozen=True)
class Listing:
    """Cameras that were found, drivers that are missing, and problems met in looking, one line each."""

    cameras: tuple[Found, ...]
    missing: tuple[Missing, ...]
    problems: tuple[str, ...] = ()


def cameras() -> Listing:
    """Look for cameras of every driver, at most a few seconds; opens none of them.

    Returns
    -------
    Listing
        Cameras that were found, drivers that are missing, and problems met in looking.
    """
    listed = _local()
    missing: list[Missing] = []
    problems: list[str] = []
    if find_spec("pypylon") is None:
        missing.append(Missing("pylon", "Basler GigE and USB3 cameras", "pip install 'zeromethod[pylon]'"))
    else:
        listed += _within("pylon", pylon_camera.found, problems)
    try:
        library()
    except InputError:
        missing.append(Missing("aravis", "GigE Vision and USB3 Vision cameras of any maker", INSTALL))
    else:
        listed += _within("aravis", aravis_camera.found, problems)
    return Listing(tuple(listed), tuple(missing), tuple(problems))


def _local() -> list[Found]:
    """Video4Linux's cameras by what the system says of them: opening one could hang, or be refused."""
    return [
        Found(folder.name[5:], _text(folder / "name") or folder.name)
        for folder in sorted(_VIDEO.glob("video*"), key=lambda path: int(path.name[5:]))
        # a camera's further nodes carry metadata, not pictures
        if _text(folder / "index") in ("", "0") and Path("/dev", folder.name).exists()
    ]


def _text(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8", errors="replace").strip()
    except OSError:
        return ""


def _within(driver: str, look: Callable[[], list[tuple[str, str]]], problems: list[str]) -> list[Found]:
    """Cameras that a maker's library knows, or a problem: it may fail, or never answer."""
    try:
        found = call_within(PATIENCE_S, look, f"listing {driver}")
    except TimeoutError:
        problems.append(f"{driver}: no answer within {PATIENCE_S:g} s")
    except RAISED as error:
        problems.append(f"{driver}: {' '.join(str(error).split()) or type(error).__name__}")
    else:
        return [Found(f"{driver}:{address}", name) for address, name in found]
    return []
