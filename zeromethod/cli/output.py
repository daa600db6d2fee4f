"""Files that a command writes: refused before the work when they cannot be, written whole after it."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from zeromethod.atomic_write import atomic_write
from zeromethod.errors import InputError


def check_file(option: str, path: Path | None, suffix: str) -> None:
    """Refuse an output file that cannot be written, with one line. None: not asked for."""
    if path is None:
        return
    if path.suffix.lower() != suffix:
        raise InputError(f"{option}: {path}: the file name must end in {suffix}")
    folder = path.absolute().parent
    if not folder.is_dir():
        raise InputError(f"{option}: {path}: the folder {folder} does not exist")
    if not os.access(path if path.exists() else folder, os.W_OK):
        raise InputError(f"{option}: {path}: not writable")


def check_folder(option: str, path: Path | None) -> None:
    """Make an output folder, or refuse it with one line. None: not asked for."""
    if path is None:
        return
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{option}: {path}: must be a folder that can be made ({error.strerror})") from error
    if not os.access(path, os.W_OK):
        raise InputError(f"{option}: {path}: not writable")


@contextmanager
def writing(option: str, path: Path) -> Iterator[None]:
    """Name the file, with InputError, that its disk does not take."""
    try:
        yield
    except OSError as error:
        why = error.strerror or " ".join(str(error).split())
        raise InputError(f"{option}: {path}: cannot be written: {why}") from None


def write_summary(path: Path, figures: dict[str, Any]) -> None:
    """Write figures as JSON, in one move, so that a reader never sees half of it; what is no number: null.

    Raises InputError where the disk does not take it.
    """
    with writing("--summary", path), atomic_write(path) as part:
        part.write_text(json.dumps(_plain(figures), indent=2) + "\n")


def _plain(value: Any) -> Any:
    """The same figures as JSON can say them."""
    if isinstance(value, dict):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if isinstance(value, np.ndarray | np.generic):
        return _plain(value.tolist())
    return None if isinstance(value, float) and not np.isfinite(value) else value
