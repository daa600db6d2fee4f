"""Files replaced in one step: whole, or as they were before."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from uuid import uuid4


@contextmanager
def atomic_write(path: Path) -> Iterator[Path]:
    """Give the name to write to; the file that is there at the end replaces `path` in one step.

    Permissions of an existing file are kept, and a link stays a link. If anything ends the writing early
    (Ctrl-C too), `path` stays as it was and no other file is left.
    """
    path = path.resolve()
    part = path.with_name(f".{path.name}.{uuid4().hex[:8]}.part")
    try:
        yield part
        if path.exists():
            part.chmod(path.stat().st_mode & 0o7777)
        with part.open("rb") as file:
            os.fsync(file.fileno())
        part.replace(path)
    finally:
        part.unlink(missing_ok=True)
