"""Reading rig files: TOML in, a checked `Rig` out, or one line that says what is wrong."""

from __future__ import annotations

from pathlib import Path

from zeromethod.errors import InputError, check_type
from zeromethod.resources import resource
from zeromethod.rig.model import Rig
from zeromethod.rig.refusal import shown
from zeromethod.toml_file import parse_toml, read_text

LIGHT_ARRAYS = ("leds",)
"""Packaged rigs of LED and photodetector arrays, which have no camera and a schema of their own."""

LIGHT_ARRAY_TABLES = frozenset({"leds", "detectors", "arrays"})
"""Tables that no rig with a camera has: one of them makes a file a rig of arrays."""

RIG_FILE = "a rig file (TOML)"
"""What is allowed, where a file is refused."""

_ARRAYS_ONLY = "arrays of LEDs and photodetectors have no camera: only `run` and `replay` take them"


def packaged_rigs() -> list[str]:
    """Names of the rigs with a camera that come with the package, sorted."""
    names = {path.stem for path in resource("calibration", "rigs").glob("*.toml")}
    return sorted(names - set(LIGHT_ARRAYS))


def rig_path(name: str | Path) -> Path:
    """Find the packaged file of a bare name (no folder, no suffix), else take the path as it is."""
    check_type("rig", name, str | Path, f"a file, or one of the packaged {', '.join(packaged_rigs())}")
    path = Path(name)
    try:
        if path.is_dir():
            raise InputError(f"rig: {shown(str(name))}: a folder: {_rig_in(path)}")
        if path.suffix or path.parent != Path() or path.is_file():
            return path
    except OSError:  # who reads it is told why
        return path
    if str(name) in LIGHT_ARRAYS:
        raise InputError(f"rig: {shown(str(name))}: {_ARRAYS_ONLY}")
    if str(name) not in packaged_rigs():
        known = ", ".join(sorted({*packaged_rigs(), *LIGHT_ARRAYS}))
        raise InputError(f"rig: {shown(str(name))}: a file, or one of the packaged {known}")
    return resource("calibration", "rigs", f"{name}.toml")


def _rig_in(folder: Path) -> str:
    """Which file to give in place of a folder: of a calibration, its rig; of many, the newest one's."""
    found = [*folder.glob("rig.toml"), *sorted(folder.glob("*/rig.toml"), reverse=True)]
    found += sorted(folder.glob("*.toml")) + sorted(folder.glob("*/*/rig.toml"), reverse=True)
    return f"give the file in it: {found[0]}" if found else "give a rig file (TOML)"


def parse_rig(text: str, path: Path, *, measured: bool = True) -> Rig:
    """Rig from the text of a rig file; `path` names it in messages and is where its files lie.

    measured: see `load_rig`.
    Raises InputError, one line "file: key: value: what is allowed", for the first thing wrong.
    """
    data = parse_toml(text, path)
    if found := sorted(LIGHT_ARRAY_TABLES & set(data), reverse=True):
        raise InputError(f"{path}: [{found[0]}]: {_ARRAYS_ONLY}")
    return Rig.checked(data, path, path.parent, measured=measured)


def load_rig(name: str | Path, *, measured: bool = True) -> Rig:
    """Rig from a file, or a packaged one by bare name ("simulated", "paper", "dome", "thin" and more).

    Files that it names (`prism.rest.file`, `camera.rest_map`, a `scenario` that ends in .toml) lie
    relative to the rig file.

    Parameters
    ----------
    name : str or Path
        A rig file, or the name of a packaged rig.
    measured : bool
        Use the rest as it was measured (`camera.rest_map`); without, its file need not exist.

    Returns
    -------
    Rig
        The checked rig.

    Raises
    ------
    InputError
        One line "file: key: value: what is allowed", for the first thing wrong.
    """
    path = rig_path(name)
    return parse_rig(read_text(path, RIG_FILE), path, measured=measured)
