"""Fine surfaces of a run: the last frames kept, and read now and then."""

from __future__ import annotations

import contextlib
import math
from collections import deque
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, nullcontext
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from zeromethod.arrays import Float, Image
from zeromethod.errors import InputError, MeasurementError
from zeromethod.exposure.target_phase import TargetPhase
from zeromethod.fine.frames import FRAMES, FineFrame
from zeromethod.fine.surface import FineSurface
from zeromethod.loop.events import Event
from zeromethod.loop.state import NULLED, State
from zeromethod.loop.step import Step
from zeromethod.optics import Optics
from zeromethod.rig.model import Rig
from zeromethod.session.fine_figures import FineFigures, figures_of
from zeromethod.session.surfaces import ReadingLost, SurfaceProcess
from zeromethod.session.zero_doubt import ZeroDoubt
from zeromethod.surface.comparison import TruthSource
from zeromethod.warp.grid import NodeGrid
from zeromethod.warp.warp import Warp
from zeromethod.worker import SameThread, Worker

if TYPE_CHECKING:
    from zeromethod.fine.reader import FineReader

EVERY_S = 0.4
"""Time from one reading to the next at least: by then all frames are new at 60 per second."""
STEP = 16
"""Pictures per period of a moving target where the rig's stands still: at most 8 % of contrast is lost."""
_OLDEST_S = 1.5
"""Age beyond which a frame is not read together with the newest."""
_PATIENCE_S, _CLOSING_S = 60.0, 0.4
"""How long a reading may take before its process is given up, and how long the end of a run waits for it."""
_BYTES_PER_NODE, _BYTES_PER_PIXEL = 260, 12
"""Shared memory: warps and phases of a frame per node; per pixel of the surface, with its images."""
_FOLLOWED = NULLED | {State.NULLING}
"""States in which frames are read: a mirror that moves is never quite nulled."""


def with_moving_target(rig: Rig) -> Rig:
    """The rig with a target that moves, as fine surfaces need it. Raises InputError for one that cannot.

    Codes are summed as light in time (`target.carry`): what rounding leaves out would be seen.
    Without bursts when needed: the target stands while they are drawn, and pixels read most of what they
    would.
    """
    if rig.target.kind != "cosines":
        raise InputError(f"--fine: target.kind {rig.target.kind!r}: only cosines are read pixel by pixel")
    target, control = rig.target, rig.control
    if not target.step:
        target = target.model_copy(update={"step": STEP})
    target = target.model_copy(update={"carry": True})
    if control.burst == "when-needed":
        control = control.model_copy(update={"burst": "never"})
    return rig.model_copy(update={"target": target, "control": control})


class LastFrames:
    """The frames that a fine reading is made of: the last ones, from one zero, none older than 1.5 s."""

    def __init__(self) -> None:
        self._frames: deque[FineFrame] = deque(maxlen=FRAMES)

    @property
    def all(self) -> tuple[FineFrame, ...]:
        """Those there are, oldest first; `FRAMES` are enough for a reading."""
        return tuple(self._frames)

    def add(self, time_ns: int, frame: FineFrame | None, new_zero: bool) -> None:
        """Take in the frame of a step, None where it cannot be used. new_zero: warps start from another."""
        if new_zero:
            self._frames.clear()
        if frame is None:
            return
        self._frames.append(frame)
        oldest_ns = time_ns - round(1e9 * _OLDEST_S)
        while self._frames[0].measured.time_ns < oldest_ns:
            self._frames.popleft()


@dataclass(frozen=True, slots=True)
class _Asked:
    frames: tuple[FineFrame, ...]
    step: Step


class FineReadings:
    """Keeps the last frames of a run and reads them: at once, or live in a process of its own.

    Live, a reading that waits is replaced by a newer one; the loop never waits.
    """

    def __init__(
        self, rig: Rig, optics: Optics, grid: NodeGrid, truth: TruthSource | None, doubt: ZeroDoubt
    ) -> None:
        self._rig, self._optics, self._grid, self._truth, self._doubt = rig, optics, grid, truth, doubt
        self._frames = LastFrames()
        self._zero: Float | None = None
        self._asked_ns: int | None = None
        self._own: FineReader | None = None
        self._process: SurfaceProcess | None = None
        self._worker: Worker[_Asked, tuple[Step, FineFigures]] | SameThread[_Asked, tuple[Step, FineFigures]]
        self._worker = SameThread(lambda: nullcontext(self._serve))
        self._lost = self._unsolved = ""

    @contextlib.contextmanager
    def in_own_process(self) -> Iterator[None]:
        """Within this context, read in a process of its own."""
        # here, so that what must be compiled is, before the run
        from zeromethod.session import fine_process  # noqa: PLC0415 - only --fine needs it

        rows, cols = self._grid.image_shape
        size = FRAMES * (rows * cols * (1 + (self._rig.camera.bits > 8)))
        size += FRAMES * _BYTES_PER_NODE * math.prod(self._grid.shape) + 4 * _BYTES_PER_PIXEL * rows * cols
        with ExitStack() as stack:
            module = fine_process.__name__
            self._process = SurfaceProcess(self._rig, self._grid, module, size, _PATIENCE_S)
            stack.callback(self._process.close)
            self._worker = Worker("read fine surface", lambda: nullcontext(self._serve), kept=1)
            stack.callback(lambda: self._worker.close(_CLOSING_S))
            yield

    @property
    def process_id(self) -> int | None:
        """Of the process that reads, as the system numbers it; None where this one does."""
        return None if self._process is None else self._process.process_id

    def add(self, step: Step) -> None:
        """Keep a step's frame, and have the last ones read when it is time. Raises what a reading raised."""
        frame = frame_of(step)
        self._frames.add(step.time_ns, frame, step.zero is not self._zero)
        self._zero = step.zero
        if frame is None:
            return
        waited = self._asked_ns is None or step.time_ns - self._asked_ns >= 1e9 * EVERY_S
        frames = self._frames.all
        if waited and len(frames) == FRAMES and step.state in _FOLLOWED:
            self._asked_ns = step.time_ns
            self._worker.post(_Asked(frames, step))

    def collect(self) -> list[tuple[Step, FineFigures]]:
        """Steps whose fine surface was read since the last call, and figures; raises what it raised."""
        try:
            return self._worker.take()
        except ReadingLost as why:
            self._lost = str(why)
            return []

    def notes(self) -> tuple[str, ...]:
        """News for the operator, each once; to be called in every step."""
        if self._process is not None:
            self._process.give_up_if_late()
        lost, self._lost = self._lost, ""
        unsolved, self._unsolved = self._unsolved, ""
        said = f"the process that reads fine surfaces is lost ({lost}): there are none any more"
        return (said,) * bool(lost) + (f"a fine surface is left out: {unsolved}",) * bool(unsolved)

    def _serve(self, asked: _Asked) -> tuple[Step, FineFigures] | None:
        try:
            surface = self._read(with_doubt(asked.frames, asked.step.zero, self._doubt))
        except InputError:  # phases that do not determine the pixels: the target stood, as a picture was kept
            return None
        except MeasurementError as why:
            self._unsolved = str(why)
            return None
        return replace(asked.step, fine=surface), figures_of(surface, asked.step.phase, self._truth)

    def _read(self, frames: Sequence[FineFrame]) -> FineSurface:
        if self._process is not None:
            surface: FineSurface = self._process.ask(frames)
            return surface
        from zeromethod.fine.reader import FineReader  # noqa: PLC0415 - only --fine needs it

        self._own = self._own or FineReader(self._rig, self._optics, self._grid)
        return self._own.read(frames)


def with_doubt(frames: Sequence[FineFrame], zero: Float | None, doubt: ZeroDoubt) -> Sequence[FineFrame]:
    """Frames of one zero, the newest, which is read, with what that leaves open of depth."""
    return (*frames[:-1], replace(frames[-1], measured=doubt.stated(frames[-1].measured, zero)))


def frame_of(step: Step) -> FineFrame | None:
    """A step's frame for the fine reading; None where it has none, or something else was drawn over it."""
    if step.image is None or step.residual is None or step.shown is None or step.measured is None:
        return None
    if Event.BURST in step.events:
        return None
    return fine_frame(step.image, step.residual.d, step.shown.q, step.measured, step.target)


def fine_frame(image: Image, d: Float, shown: Float, measured: Warp, target: TargetPhase | None) -> FineFrame:
    """One frame for the fine reading; d, shown and measured as `FineFrame` has them.

    target: its known phase in the frame; None: it stands.
    """
    if target is None:
        still = np.zeros(d.shape)
        phases = still, still + 1.0, still
    else:
        phases = target.node_rad, target.node_contrast, target.node_late_rad_per_s
    return FineFrame(image, *phases, shown, measured, d)
