"""What came of frames that were handed over to be written."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from zeromethod.recording.schema import number_name
from zeromethod.recording.source import Source


def frames_in(path: Path, wanted: Callable[[int], bool]) -> int:
    """Frames that are in a file: in its table of turns, and with their arrays where `wanted`.

    Raises InputError where the file cannot be read.
    """
    source = Source(path)
    try:
        turns = source.table("turns/table")
        numbers = turns["number"][turns["frame_number"] >= 0]
        # these have something of every frame
        groups = [group for group in ("warps/commanded", "frames") if number_name(group) in source.names]
        if not groups:
            return len(numbers)
        group = groups[0]
        length = min(source.length(name) for name in source.group(group))
        kept = np.isin(numbers, source.table(number_name(group))[:length])
        return sum(there or not wanted(int(number)) for number, there in zip(numbers, kept, strict=True))
    finally:
        source.close()
