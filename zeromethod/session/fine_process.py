"""The process that reads fine surfaces, at its own pace and lower priority."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from zeromethod.fine.frames import FineFrame
from zeromethod.fine.reader import FineReader
from zeromethod.fine.surface import FineSurface
from zeromethod.optics import Optics
from zeromethod.rig.model import Rig
from zeromethod.session.surfaces import serve
from zeromethod.warp.grid import NodeGrid


def _reads(rig: Rig, grid: NodeGrid) -> Callable[[Sequence[FineFrame]], FineSurface]:
    return FineReader(rig, Optics(rig), grid).read


def main() -> None:
    """Frames come in at standard input, fine surfaces go out at standard output."""
    serve(_reads)
