"""Files replaced in one step: whole, or as they were before."""

from __future__ import annotations

import errno
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from uuid import uuid4


@contextmanager
def atomic_write(path: Path) -> Iterator[Path]:
    """Give the name to write to; the file that is there at the end replaces `path` in one step.

    Permissions of an existing file are kept, and a link stays a link. If anything ends the writing early
    (Ctrl-C too), `path` stays as it was and no other file is left. OSError names `path`.
    """
    path = path.resolve()
    part = _part_of(path)
    try:
        yield part
        if path.exists():
            part.chmod(path.stat().st_mode & 0o7777)
        with part.open("rb") as file:
            os.fsync(file.fileno())
        part.replace(path)
    except OSError as error:
        if error.errno is None or error.filename is not None:
            raise
        raise OSError(error.errno, os.strerror(error.errno), str(path)) from None
    finally:
        part.unlink(missing_ok=True)


def check_writable(path: Path) -> None:
    """Raise OSError where `atomic_write` could not write a file: tried, for permissions do not say it all."""
    path = path.resolve()
    if path.is_dir():
        raise OSError(errno.EISDIR, os.strerror(errno.EISDIR))
    if path.exists() and not path.is_file():
        # replacing a device would take it from the system
        raise OSError(errno.EINVAL, "not a file")
    if path.exists() and not os.access(path, os.W_OK):
        raise OSError(errno.EACCES, os.strerror(errno.EACCES))
    part = _part_of(path)
    try:
        part.touch(exist_ok=False)
    finally:
        part.unlink(missing_ok=True)


def _part_of(path: Path) -> Path:
    return path.with_name(f".{path.name}.{uuid4().hex[:8]}.part")
