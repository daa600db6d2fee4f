"""Arrays that take long to work out: shipped with the packaged rigs, or kept in the user's cache folder."""

from __future__ import annotations

import hashlib
import json
import os
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from zeromethod.arrays import Float
from zeromethod.atomic_write import atomic_write
from zeromethod.resources import resource


def cache_folder() -> Path:
    """`ZEROMETHOD_CACHE`, else `zeromethod` in the user's cache folder."""
    own = os.environ.get("ZEROMETHOD_CACHE")
    if own:
        return Path(own)
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "zeromethod"


def kept_arrays(
    kind: str, depends_on: dict[str, Any], make: Callable[[], dict[str, Float]]
) -> dict[str, Float]:
    """Arrays from their file if there is one, else worked out and kept where the folder can be written.

    depends_on: all that they depend on, as JSON can have it; lengths and angles rounded, so that a last digit
    that one machine computes otherwise makes no other arrays.
    """
    key = hashlib.sha256(json.dumps(depends_on, sort_keys=True).encode()).hexdigest()[:20]
    name = f"{kind}-{key}.npz"
    file = cache_folder() / name
    for there in (resource("calibration", "bodies", name), file):
        try:
            with there.open("rb") as kept_in, np.load(kept_in) as kept:
                return dict(kept)
        except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile):
            # none yet, or not a whole one
            continue
    made = make()
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        with atomic_write(file) as part, part.open("wb") as out:
            named: dict[str, Any] = made
            np.savez(out, **named)
    except OSError:
        # a folder that cannot be written costs the same time again in the next process
        pass
    return made
