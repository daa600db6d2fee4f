"""The surfaces of a run: read in the run's own process, or in real time in one beside it."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from zeromethod.optics import Optics
from zeromethod.rig.model import Rig
from zeromethod.session.surface_process import ReadingLost, SurfaceProcess
from zeromethod.surface import Peak, Surface, SurfaceReader, peak
from zeromethod.warp.grid import NodeGrid
from zeromethod.warp.warp import Warp


class Surfaces:
    """Reads the warps of a run in turn, wherever that is done."""

    def __init__(self, rig: Rig, optics: Optics, grid: NodeGrid) -> None:
        """As `SurfaceReader`."""
        self._rig, self._grid = rig, grid
        self._own = SurfaceReader(rig, optics, grid)
        self._process: SurfaceProcess | None = None
        self._ended = False
        self._untold = ""

    @contextmanager
    def beside(self, first: Warp) -> Iterator[None]:
        """Meanwhile read in a process of its own: with one interpreter, the loop waits while reading has it.

        first: read at once, so that no later one waits for code to be compiled.
        """
        self._ended = False
        process: SurfaceProcess | None = None
        try:
            self._process = process = SurfaceProcess(self._rig, self._grid)
        except ReadingLost as why:
            self._give_up(why)
        try:
            self.read(first)
            yield
        finally:
            self._ended = True
            self._process = None
            if process is not None:
                process.close()

    def read(self, warp: Warp) -> tuple[Surface, Peak]:
        """Surface of a measured warp, and its peak; raises as `SurfaceReader.read`."""
        process = self._process
        if process is not None:
            try:
                return process.read(warp)
            except ReadingLost as why:
                if self._ended:
                    raise
                self._give_up(why)
        surface = self._own.read(warp)
        return surface, peak(surface)

    def _give_up(self, why: ReadingLost) -> None:
        self._process = None
        self._untold = f"the process that reads surfaces is lost ({why}): the run's own does, and is slower"

    def notes(self) -> tuple[str, ...]:
        """What the operator should know, told once; to be asked in every turn."""
        process, untold = self._process, self._untold
        if process is not None:
            process.give_up_if_late()
        self._untold = ""
        return (untold,) if untold else ()
