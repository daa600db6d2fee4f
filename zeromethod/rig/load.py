"""Reading rig files: TOML in, a checked `Rig` out, or one line that says what is wrong."""

from __future__ import annotations

import json
import tomllib
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ValidationError

from zeromethod.errors import InputError
from zeromethod.resources import resource
from zeromethod.rig.model import CameraSpec, DisplaySpec, Rig
from zeromethod.rig.refusal import first_refusal, shown, unknown_key

SCHEMA_VERSION = 1

_DEVICES: dict[str, type[BaseModel]] = {"display": DisplaySpec, "camera": CameraSpec}
_SIMULATED = "simulated"

REST_MAP_SUFFIXES = (".npz", ".h5")
"""What a file with a rest map may be called."""


def packaged_rigs() -> list[str]:
    """Names of the rigs that come with the package, sorted."""
    return sorted(path.stem for path in resource("calibration", "rigs").glob("*.toml"))


def _path(name: str | Path) -> Path:
    """Find the packaged file of a bare name (no folder, no suffix), else take the path as it is."""
    path = Path(name)
    if path.suffix or path.parent != Path() or path.is_file():
        return path
    if str(name) not in packaged_rigs():
        known = ", ".join(packaged_rigs())
        raise InputError(f"rig: {shown(str(name))}: a file, or one of the packaged {known}")
    return resource("calibration", "rigs", f"{name}.toml")


def read_text(path: Path) -> str:
    """Text of a rig file, line ends as they are. Raises InputError where it cannot be read."""
    try:
        return path.read_bytes().decode("utf-8")
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: byte {error.start}: not UTF-8: a rig file is UTF-8 text") from None
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}: a rig file (TOML)") from None


def _check_version(data: dict[str, Any]) -> str | None:
    version = data.get("schema_version")
    if type(version) is int and version == SCHEMA_VERSION:
        return None
    value = shown(version) if "schema_version" in data else "missing"
    return f"schema_version: {value}: {SCHEMA_VERSION} is what this version of zeromethod reads"


def _check_simulated_options(data: dict[str, Any]) -> str | None:
    """Refuse keys that a driver of one's own could take but the simulated device does not."""
    for table, model in _DEVICES.items():
        given = data.get(table)
        if not isinstance(given, dict) or given.get("driver", _SIMULATED) != _SIMULATED:
            continue
        known = list(model.model_fields)
        for key in given:
            if key not in known:
                return unknown_key((table, key), known)
    return None


def parse_rig(text: str, path: Path, *, measured: bool = True) -> Rig:
    """Rig from the text of a rig file; `path` names it in messages and is where its files lie.

    measured: see `load_rig`.
    Raises InputError, one line "file: key: value: what is allowed", for the first thing wrong.
    """
    try:
        data = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise InputError(f"{path}: {error}: not TOML") from None
    if refusal := _check_version(data) or _check_simulated_options(data):
        raise InputError(f"{path}: {refusal}")
    try:
        # By way of JSON, where pydantic's strict mode still takes a list for a tuple and text for a path.
        rig = Rig.model_validate_json(json.dumps(data, default=str), strict=True)
    except ValidationError as error:
        raise InputError(f"{path}: {first_refusal(error, Rig)}") from None
    if not measured:
        rig = rig.model_copy(update={"camera": rig.camera.model_copy(update={"rest_map": None})})
    return _resolved(rig, path)


def _resolved(rig: Rig, path: Path) -> Rig:
    """Rig with the files that it names made relative to its own; refuses those that are not there."""
    rest = rig.prism.rest
    update: dict[str, Any] = {}
    if rest.file is not None:
        file = path.parent / rest.file
        if not file.is_file():
            raise InputError(f"{path}: prism.rest.file: {shown(str(rest.file))}: an existing .npy file")
        update["prism"] = rig.prism.model_copy(update={"rest": rest.model_copy(update={"file": file})})
    if rig.camera.rest_map is not None:
        file = path.parent / rig.camera.rest_map
        if not (file.is_file() and file.suffix in REST_MAP_SUFFIXES):
            allowed = f"an existing {' or '.join(REST_MAP_SUFFIXES)} file with a rest map"
            raise InputError(f"{path}: camera.rest_map: {shown(str(rig.camera.rest_map))}: {allowed}")
        update["camera"] = rig.camera.model_copy(update={"rest_map": file})
    if rig.press.endswith(".toml"):
        press = path.parent / rig.press
        if not press.is_file():
            raise InputError(f"{path}: press: {shown(rig.press)}: an existing press file or a packaged name")
        update["press"] = str(press)
    return rig.model_copy(update=update) if update else rig


def load_rig(name: str | Path, *, measured: bool = True) -> Rig:
    """Rig from a file, or a packaged one by bare name ("simulated", "paper").

    Files that it names (`prism.rest.file`, `camera.rest_map`, a `press` that ends in .toml) lie relative to
    the rig file.

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
    path = _path(name)
    return parse_rig(read_text(path), path, measured=measured)
