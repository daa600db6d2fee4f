"""The constant of frame after frame: what was learned serves many, and is learned again beside them.

Learning takes a tenth of a second and more. In readings that follow each other it runs in a thread of its own, from one
frame's slopes, and takes effect a fixed number of frames later, so that the same frames give the same depths. Until
then sigma says how far what is read is from what was learned.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from threading import TIMEOUT_MAX

import numpy as np

from zeromethod.surface.pass_result import PassResult
from zeromethod.surface.constant import LoadConstant
from zeromethod.surface.integrate import LinearIntegration
from zeromethod.surface.learned import Learned
from zeromethod.worker import Worker

_LAG_FRAMES = 12
"""Frames from slopes to the weights learned from them: 0.2 s at 60 Hz, twice what learning several loads takes."""
_EVERY_FRAMES, _AT_MOST = 60, 3
"""One learning is allowed for so many frames, a fifth of a core at 60 Hz; so many are saved up for a sudden press."""
_SAME_MM = 1e-3
"""Step of the constant from which loads are learned again within one reading: fields then err by a tenth."""


class KeptConstant:
    """The constant of each reading of one reader."""

    def __init__(self, constant: LoadConstant) -> None:
        self._constant = constant
        self._kept: Learned | None = None
        self._worker: Worker[Callable[[], Learned], Learned] | None = None
        self._frame, self._due, self._allowed = 0, -1, float(_AT_MOST)
        self._follows = False

    def begin(self, follows: bool) -> None:
        """Begin a reading. follows: it comes next to the one before, so that what was learned is kept."""
        self._follows = follows and self._kept is not None
        if not self._follows:
            return
        self._frame += 1
        self._allowed = min(self._allowed + 1.0 / _EVERY_FRAMES, _AT_MOST)
        if self._worker is not None and self._frame == self._due:
            (self._kept,) = self._worker.take(TIMEOUT_MAX)
            self._due = -1

    def of(
        self, read: PassResult, linear: LinearIntegration, first: bool, step_mm: float, time_ns: int
    ) -> tuple[float, float]:
        """(constant, its standard deviation), mm.

        first: of this reading; step_mm: of its constant before. time_ns: of the picture.
        """
        constant = self._constant
        x, y = read.point[..., 0], read.point[..., 1]
        blocks = constant.reader.read(read.slope, read.variance, read.depth, x, y, read.island)
        if not constant.knows_body:
            return constant.open(blocks)
        kept = self._kept
        alike = kept is not None and np.array_equal(kept.used, blocks.used)

        def learn(before: Learned | None, again: bool = True) -> Learned:
            found = constant.learn(blocks, read.variance, read.island, linear, before, again)
            return replace(found, from_ns=time_ns if again or before is None else before.from_ns)

        if not self._follows:
            if first or abs(step_mm) > _SAME_MM or not alike:
                kept = learn(None if first else kept)
        elif not alike:
            kept = learn(kept, again=False)
        assert kept is not None
        self._kept = kept
        if (
            self._follows
            and first
            and self._due < self._frame
            and self._allowed >= 1.0
            and kept.changed(blocks)
        ):
            self._allowed -= 1.0
            self._due = self._frame + _LAG_FRAMES
            if self._worker is None:
                self._worker = Worker("loads", _serving)
            self._worker.post(lambda: learn(kept))
        return kept.of(blocks)

    @property
    def learned_ns(self) -> int:
        """Time of the picture that the weights in use were learned from; 0 before the first."""
        return 0 if self._kept is None else self._kept.from_ns


@contextmanager
def _serving() -> Iterator[Callable[[Callable[[], Learned]], Learned]]:
    yield lambda learn: learn()
