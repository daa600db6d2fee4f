"""How many frames a file holds, when whoever wrote it can no longer be asked."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from zeromethod.errors import InputError
from zeromethod.recording.schema import number_name
from zeromethod.recording.source import RecordingFile


def frames_in(path: Path, wanted: Callable[[int], bool]) -> int | None:
    """Frames that are in a file: in its table of steps, and with their arrays where `wanted`.

    None where it cannot be read.
    """
    try:
        source = RecordingFile(path)
    except InputError:
        return None
    try:
        with source.silence():
            steps = source.rows("steps")
        numbers = steps["number"][steps["frame_number"] >= 0]
        # one of these has an item for every frame
        groups = [group for group in ("warps/commanded", "frames") if number_name(group) in source.names]
        if not groups:
            return len(numbers)
        length = min(source.length(name) for name in source.group(groups[0]))
        kept = np.isin(numbers, source.table(number_name(groups[0]))[:length])
        return sum(bool(there) or not wanted(int(one)) for one, there in zip(numbers, kept, strict=True))
    except InputError:
        return None
    finally:
        source.close()
