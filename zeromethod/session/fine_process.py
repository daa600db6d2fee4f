"""The process that reads fine surfaces, at its own pace and lower priority."""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Sequence

from zeromethod.fine.frames import FineFrame
from zeromethod.fine.reader import FineReader
from zeromethod.fine.surface import FineSurface
from zeromethod.optics import Optics
from zeromethod.rig.model import Rig
from zeromethod.session.surfaces import serve
from zeromethod.warp.grid import NodeGrid


def _reads(rig: Rig, grid: NodeGrid) -> Callable[[Sequence[FineFrame]], FineSurface]:
    reader = FineReader(rig, Optics(rig), grid)
    # what tracing the rays took; the C library of some systems cannot give it back
    give_back = getattr(ctypes.CDLL(None), "malloc_trim", None)
    if give_back is not None:
        give_back(0)
    return reader.read


def main() -> None:
    """Frames come in at standard input, fine surfaces go out at standard output."""
    serve(_reads, keeps=False)  # frames take 90 MB
