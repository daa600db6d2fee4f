"""The constant of frame after frame: what was learned serves many, and is learned again beside them.

Learning takes a tenth of a second and more. In readings that follow each other it runs in a thread of its
own, from one frame's slopes, and takes effect a fixed number of frames later, so that the same frames give
the same depths. Until then sigma says how far what is read is from what was learned.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from zeromethod.arrays import Float
from zeromethod.surface.block_readings import BlockReadings
from zeromethod.surface.constant import LoadConstant
from zeromethod.surface.integrate import SlopeIntegrator
from zeromethod.surface.learned import Learned
from zeromethod.surface.pass_result import PassResult
from zeromethod.worker import in_thread

_LAG_FRAMES = 12
"""Frames from slopes to the weights learned from them: 0.2 s at 60 Hz, twice what learning several loads
takes."""
_EVERY_FRAMES, _AT_MOST = 36, 3
"""One learning, 0.12 s of one press, is allowed for so many frames, a fifth of a core; so many are saved."""
_SAME_MM = 1e-3
"""Constant up to which slopes are the true mirror's to a ten-thousandth: by these loads are learned."""


@dataclass(frozen=True, slots=True)
class Constant:
    """The constant and its standard deviation, mm; false_constant: as `RestFit` has it."""

    constant_mm: float
    sigma_mm: float
    false_constant: Callable[[Float, Float], float]


class KeptConstant:
    """The constant of each reading of one reader."""

    def __init__(self, constant: LoadConstant) -> None:
        self._constant = constant
        self._kept: Learned | None = None
        self._learning: Future[Learned] | None = None
        self._frame, self._due, self._allowed = 0, -1, float(_AT_MOST)
        self._urgent = self._follows = False
        self._time_ns = 0

    def begin(self, follows: bool, time_ns: int, learned: Learned | None) -> None:
        """Begin a reading. follows: it comes next to the one before, so that what was learned is kept.

        learned: what is to be kept instead, by whoever asks for it.
        """
        self._follows, self._time_ns = follows and self._kept is not None, time_ns
        if learned is not None or not self._follows:
            self._kept, self._learning, self._due = learned, None, -1
            return
        self._frame += 1
        self._allowed = min(self._allowed + 1.0 / _EVERY_FRAMES, _AT_MOST)
        if self._learning is not None and self._frame == self._due:
            self._kept, self._learning = self._learning.result(), None

    def of(
        self, read: PassResult, integrator: SlopeIntegrator, first: bool, last: bool, step_mm: float
    ) -> Constant:
        """The constant of what was read.

        first: of this reading's passes; step_mm: of its constant before. last: False where slopes change yet.
        """
        constant = self._constant
        blocks = constant.reader.read(read)
        false_constant = partial(self._false, read, blocks)
        if not constant.knows_body:
            kept = self._kept
            found = constant.open(blocks) if kept is None else kept.of(blocks, kept.chi2_of(blocks))
            return Constant(*found, false_constant)
        alike = self._kept is not None and np.array_equal(self._kept.used, blocks.used)

        def learning() -> Callable[..., Learned]:
            # of its own: passes go on moving points while the thread learns
            x, y = np.moveaxis(read.point[..., :2], -1, 0).copy()
            return partial(constant.learn, blocks, read.variance, read.island, integrator.linear(x, y))

        if self._follows and self._kept is not None:
            if not alike:
                self._kept = learning()(self._kept, again=False)
            chi2 = self._kept.chi2_of(blocks)
            self._learn_beside(chi2, learning, first and last)
            if not self._kept.serves(chi2):
                return Constant(*constant.open(blocks), false_constant)
            return Constant(*self._kept.of(blocks, chi2), false_constant)
        if self._kept is None or abs(step_mm) > _SAME_MM or not alike or (first and last):
            found_mm, sigma_mm = constant.open(blocks)
            if first and self._kept is None and abs(found_mm) > _SAME_MM:
                return Constant(found_mm, sigma_mm, false_constant)
            self._kept = replace(learning()(self._kept), from_ns=self._time_ns)
        return Constant(*self._kept.of(blocks, self._kept.chi2_of(blocks)), false_constant)

    def _learn_beside(self, chi2: float, learning: Callable[[], Callable[..., Learned]], once: bool) -> None:
        """Learn in the thread, where that is worth its time and allowed."""
        kept = self._kept
        assert kept is not None
        urgent = not kept.serves(chi2)
        # a press waits neither for what is learned of noise, nor for what changes of noise are allowed
        waits = self._due >= self._frame and (self._urgent or not urgent)
        if once and not waits and kept.changed(chi2) and (self._allowed >= 1.0 or urgent):
            self._allowed = max(self._allowed - 1.0, 0.0)
            self._due, self._urgent = self._frame + _LAG_FRAMES, urgent
            at_ns, learn = self._time_ns, learning()
            self._learning = in_thread("loads", lambda: replace(learn(kept), from_ns=at_ns))

    def _false(self, read: PassResult, blocks: BlockReadings, slope: Float, ratio: Float) -> float:
        false = self._constant.reader.means(slope, ratio, read.island)
        if self._kept is None:
            return self._constant.open_constant(blocks, false)
        return self._kept.likeliest.constant(false)

    @property
    def learned(self) -> Learned | None:
        """What serves now; None where nothing was learned."""
        return self._kept
