"""Which cameras are connected, and what would have to be installed to find more."""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

from zeromethod.drivers import aravis_camera, pylon_camera
from zeromethod.drivers.aravis_library import INSTALL, library
from zeromethod.errors import InputError

_VIDEO = Path("/sys/class/video4linux")
_PATIENCE_S = 5.0
"""A maker's library that has not answered by then is not waited for."""


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
    answers: list[list[tuple[str, str]]] = []
    errors: list[str] = []

    def ask() -> None:
        try:
            answers.append(look())
        except Exception as error:
            errors.append(" ".join(str(error).split()) or type(error).__name__)

    thread = threading.Thread(target=ask, name=f"listing {driver}", daemon=True)
    thread.start()
    thread.join(_PATIENCE_S)
    if not answers:
        problems.append(f"{driver}: {errors[0] if errors else f'no answer within {_PATIENCE_S:g} s'}")
    return [Found(f"{driver}:{address}", name) for answer in answers for address, name in answer]
