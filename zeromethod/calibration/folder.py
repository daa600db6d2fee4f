"""A calibration on disk: a dated folder next to the rig file.

    calibrations/<rig>/<time>/
        calibration.toml   parameters with sigma, verdict, fingerprint, what to measure next: for people
        rig.toml           the rig file with everything that was found: what `run --rig` takes
        given.toml         the rig file as it was
        arrays.h5          rest map, covariance, presses, and the raw sums to evaluate again
        *.png              pictures

A folder is there whole or not at all.
"""

from __future__ import annotations

import enum
import os
import shutil
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
import tomlkit

from zeromethod.arrays import Image
from zeromethod.calibration.level import Level
from zeromethod.errors import InputError
from zeromethod.resources import resource
from zeromethod.rig.load import load_rig
from zeromethod.rig.save import save_values
from zeromethod.toml_file import parse_toml, read_text

SCHEMA_VERSION = 1
REST_MAP, RAW_SUMS = "rest_map/lcd_px", "raw/sums"
DOCUMENT, RIG, GIVEN, ARRAYS = "calibration.toml", "rig.toml", "given.toml", "arrays.h5"

OLD_DAYS = 30.0
"""Age from which a calibration is worth a word: rubber creeps, mounts move, lamps age."""

_HEAD = "What `zeromethod calibrate` found, for people to read; `zeromethod run` takes {rig} next to it."
_STAMP = "%Y-%m-%dT%H-%M-%S"
_LARGE = 4096


@dataclass(frozen=True)
class Stored:
    """A calibration as it stands in its folder.

    Attributes
    ----------
    folder : Path
        Where it is.
    document : dict
        What calibration.toml holds, as plain values.
    """

    folder: Path
    document: dict[str, Any]

    @property
    def rig_file(self) -> Path:
        """The calibrated rig."""
        return self.folder / RIG

    @property
    def fingerprint(self) -> dict[str, dict[str, Any]]:
        """The bench that it belongs to."""
        value = self.document["fingerprint"]
        assert isinstance(value, dict)
        return value

    @property
    def level(self) -> Level:
        """How far it can be trusted."""
        return Level(self.document["verdict"]["level"])

    @property
    def parameters(self) -> dict[str, tuple[float, float]]:
        """Value and sigma of every fitted parameter."""
        return {
            name: (float(entry["value"]), float(entry["sigma"]))
            for name, entry in self.document["parameters"].items()
        }

    @property
    def words(self) -> str:
        """Which one it is, how old, and how far it can be trusted, in a few words."""
        days = self.age_days()
        age = f"{days:.0f} days old" if days >= 2 else f"{24 * days:.0f} hours old"
        level = self.document["verdict"].get("level")
        return f"{self.folder.name}, {age}" + (f", {level}" if level else "")

    def age_days(self, now: datetime | None = None) -> float:
        """Days since it was made.

        Parameters
        ----------
        now : datetime, optional
            The present, unless given.

        Returns
        -------
        float
            Days.
        """
        made: datetime = self.document["time"]
        return ((now or datetime.now(UTC)) - made).total_seconds() / 86400

    def age_warning(self, now: datetime | None = None) -> str | None:
        """What to do where it is old; None while it is not.

        Parameters
        ----------
        now : datetime, optional
            The present, unless given.

        Returns
        -------
        str or None
            One line.
        """
        days = self.age_days(now)
        if days <= OLD_DAYS:
            return None
        return f"the calibration is {days:.0f} days old: zeromethod calibrate makes a new one"


def rig_source(name: str | Path) -> Path:
    """File of a rig as `--rig` takes it: the file itself, or the packaged one of that name."""
    path = Path(name)
    return path if path.is_file() else resource("calibration", "rigs", f"{name}.toml")


def home_of(name: str | Path) -> Path:
    """Folder that holds all calibrations of a rig: next to its file, or here for a packaged one.

    A calibrated rig.toml belongs where its folder lies.
    """
    path = Path(name)
    if not path.is_file():
        return Path("calibrations", str(name))
    if path.name == RIG and (path.parent / DOCUMENT).is_file():
        return path.absolute().parent.parent
    return path.parent / "calibrations" / path.stem


def calibrations(name: str | Path) -> list[Path]:
    """Folders of a rig's calibrations, the oldest first."""
    home = home_of(name)
    return sorted(
        path.parent for path in home.glob(f"*/{DOCUMENT}") if not path.parent.name.endswith(".part")
    )


def newest(name: str | Path) -> Stored | None:
    """The rig's calibration made last; None where there is none."""
    found = calibrations(name)
    return load(found[-1]) if found else None


def calibration_of(rig_file: str | Path) -> Stored | None:
    """The calibration that a rig file is part of; None for any other rig file."""
    folder = Path(rig_file).parent
    return load(folder) if Path(rig_file).name == RIG and (folder / DOCUMENT).exists() else None


def lacks_document(rig_file: str | Path, rest_map: Path | None) -> bool:
    """Whether a rig file takes the rest map of a calibration next to it whose calibration.toml is missing.

    rest_map: the file that the rig names. `calibration_of` then has nothing to compare a bench with.
    """
    folder = Path(rig_file).absolute().parent
    return (
        rest_map is not None and rest_map.absolute() == folder / ARRAYS and not (folder / DOCUMENT).exists()
    )


def read_document(path: Path, allowed: str) -> dict[str, Any]:
    """A TOML file that zeromethod wrote. Raises InputError, which ends with what is `allowed`, for others."""
    document = parse_toml(read_text(path, allowed), path, allowed)
    version = document.get("schema_version")
    if version != SCHEMA_VERSION:
        raise InputError(
            f"{path}: schema_version: {version!r}: {SCHEMA_VERSION} is what this version of zeromethod reads"
        )
    return document


def load(folder: Path) -> Stored:
    """Read calibration.toml of a folder. Raises InputError for anything else."""
    path = folder / DOCUMENT
    document = read_document(path, "a folder that zeromethod calibrate made")
    for key, kind in (("time", datetime), ("parameters", dict), ("fingerprint", dict), ("verdict", dict)):
        if not isinstance(document.get(key), kind):
            raise InputError(f"{path}: {key}: missing: a calibration as zeromethod writes it")
    return Stored(folder, document)


def load_arrays(folder: Path, *wanted: str) -> dict[str, Image]:
    """Arrays of a folder by name ("rest_map/lcd_px"), all of them or those wanted. Raises InputError."""
    import h5py  # noqa: PLC0415 - `run` reads no arrays here, and it loads slowly

    path = folder / ARRAYS
    found: dict[str, Image] = {}
    try:
        with h5py.File(path, "r") as file:

            def take(name: str, item: object) -> None:
                if isinstance(item, h5py.Dataset) and (not wanted or name in wanted):
                    found[name] = item.asstr()[()] if item.dtype.kind == "O" else item[()]

            file.visititems(take)
    except (OSError, RuntimeError, KeyError):  # what h5py makes of a damaged file
        raise InputError(f"{path}: cannot be read: arrays of a calibration (HDF5)") from None
    missing = [name for name in wanted if name not in found]
    if missing:
        raise InputError(f"{path}: {missing[0]}: missing: arrays of a calibration")
    return found


class ArraysFault(enum.StrEnum):
    """Why `run` and evaluating again cannot use a folder's arrays."""

    MISSING = "missing"
    UNREADABLE = "cannot be read"


def arrays_fault(folder: Path) -> ArraysFault | None:
    """What is wrong with a folder's arrays; None where they can be used."""
    if not (folder / ARRAYS).is_file():
        return ArraysFault.MISSING
    try:
        load_arrays(folder, REST_MAP, RAW_SUMS)
    except InputError:
        return ArraysFault.UNREADABLE
    return None


def store(
    name: str | Path,
    document: Mapping[str, Any],
    values: Mapping[str, Any],
    arrays: Mapping[str, Any],
    *,
    settings: Mapping[str, Any] | None = None,
    pictures: Mapping[str, Callable[[Path], object]] | None = None,
    home: Path | None = None,
) -> Stored:
    """Write a calibration of the rig `name`, and read it back.

    document: plain values, with "time" (UTC), which names the folder. values: of the rig file, by dotted key.
    arrays: by name. settings: of the rig file, too, as they were used, not found. pictures: what draws each
    file. home: where the folder is made; `home_of(name)` unless given.

    Raises InputError where the folder cannot be written.
    """
    home = home or home_of(name)
    source = rig_source(name)
    try:
        home.mkdir(parents=True, exist_ok=True)
        folder = _free(home, document["time"])
        part = folder.with_name(folder.name + ".part")
        shutil.rmtree(part, ignore_errors=True)
        part.mkdir()
        try:
            moved = _moved_files(source, part)
            save_values(source, moved | dict(settings or {}), part / GIVEN)
            _write_arrays(part / ARRAYS, arrays)
            measured = {"camera.rest_map": ARRAYS} if REST_MAP in arrays else {}
            save_values(part / GIVEN, measured | dict(values), part / RIG)
            for file, draw in (pictures or {}).items():
                draw(part / file)
            text = tomlkit.dumps(_plain({"schema_version": SCHEMA_VERSION, **document}))
            (part / DOCUMENT).write_text(f"# {_HEAD.format(rig=RIG)}\n{text}", encoding="utf-8")
            part.rename(folder)
        finally:
            shutil.rmtree(part, ignore_errors=True)  # where it did not come to that
    except OSError as error:
        raise InputError(f"{home}: cannot be written: {error.strerror}: a folder of yours") from None
    return load(folder)


def _free(home: Path, time: datetime) -> Path:
    """Folder of that time that is not there yet."""
    stamp = time.strftime(_STAMP)
    folder, count = home / stamp, 1
    while folder.exists():
        count += 1
        folder = home / f"{stamp}-{count}"
    return folder


def _moved_files(source: Path, folder: Path) -> dict[str, str]:
    """Keys of files that a rig file names, as they are called from `folder`."""
    rig = load_rig(source)
    moved = {}
    if rig.scenario.endswith(".toml"):
        moved["scenario"] = os.path.relpath(rig.scenario, folder)
    if rig.prism.rest.file is not None:
        moved["prism.rest.file"] = os.path.relpath(rig.prism.rest.file, folder)
    if rig.camera.rest_map is not None:
        moved["camera.rest_map"] = os.path.relpath(rig.camera.rest_map, folder)
    return moved


def _write_arrays(path: Path, arrays: Mapping[str, Any]) -> None:
    import h5py  # noqa: PLC0415 - as above

    with h5py.File(path, "w") as file:
        file.attrs["schema_version"] = SCHEMA_VERSION
        for name, value in arrays.items():
            if isinstance(value, np.ndarray) and value.size > _LARGE:
                file.create_dataset(name, data=value, compression="gzip", compression_opts=1, shuffle=True)
            else:
                file[name] = list(value) if isinstance(value, tuple) else value


def _plain(value: Any) -> Any:
    """As TOML holds it: nothing that is not a number, seven digits, numpy's types as Python's."""
    if isinstance(value, Mapping):
        return {str(k): _plain(v) for k, v in value.items() if not _nothing(v)}
    if isinstance(value, np.ndarray | np.generic):
        return _plain(value.tolist())
    if isinstance(value, list | tuple):
        return [_plain(one) for one in value]
    if isinstance(value, float):
        return float(f"{value:.7g}")
    return value


def _nothing(value: Any) -> bool:
    return value is None or (isinstance(value, float | np.floating) and not np.isfinite(value))
