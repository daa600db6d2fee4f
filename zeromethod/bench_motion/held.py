"""Watch over the bench while a press is held: what has moved since the press last changed.

A press that goes on changes the warp where it is; camera, LCD and prism change it everywhere, in the few
patterns of `modes`. So a warp is held against the mean of some before it, where the press bends it little: a
camera that turns moves the press in the view, too.
"""

from __future__ import annotations

from collections import deque

import numpy as np

from zeromethod.arrays import Float, Mask
from zeromethod.bench_motion.fit import LEAST_NODES, MotionFitter, Terms
from zeromethod.bench_motion.modes import BenchModes
from zeromethod.warp.grid import NodeGrid
from zeromethod.warp.jacobian import jacobian
from zeromethod.warp.warp import Warp

REFERENCE_FRAMES = 4
"""Frames in which nothing changes whose mean later ones are held against."""

MOST_BENT = 0.1
"""How much a press may stretch the warp, relative, where it is looked at: a camera that turns by a pixel
moves a dent by a quarter of one."""

HELD_FRAMES = 4
"""Frames whose mean is held against the reference, since the last jump."""

_LEAST_SHARE = 0.2
"""Share of the view that must be bent as little."""

_MOST_AMPLIFIED = 5.0
"""Error over the view per error at these nodes, above which they do not fix a motion."""

_SIGMAS = 4.0
"""Standard deviations of noise above which a frame has changed."""


class HeldPress:
    """The warp of a held press, as long as nothing but the bench may have moved since."""

    def __init__(self, modes: BenchModes, grid: NodeGrid, visible: Mask) -> None:
        """visible: (rows, cols) nodes that are seen at rest."""
        self.moving_frames: int
        """Consecutive frames, by whoever judges them, in which the bench moved, however far."""
        self._modes, self._grid, self._visible = modes, grid, visible
        self.forget()

    def forget(self) -> None:
        """Begin again with the next frame."""
        self.fitter: MotionFitter | None = None
        self._sum: Float | None = None
        self._valid = self._visible
        self._frames = self.moving_frames = 0
        self._first: Terms | None = None
        self._last: deque[Terms] = deque(maxlen=HELD_FRAMES)

    @property
    def settled(self) -> bool:
        """Whether as many frames agree as are averaged."""
        return len(self._last) == HELD_FRAMES

    def look(self, warp: Warp, rest_q: Float, whole: Terms) -> Terms | None:
        """What a frame has moved by since the press was last seen to change; None while that is not known.

        whole: terms of the frame against `rest_q`, (rows, cols, 2) LCD px, of all the view.
        """
        if self.fitter is None:
            self._add(warp, rest_q, whole)
            return None
        assert self._sum is not None
        terms = self.fitter.fit(warp, self._sum)
        if terms is None:
            self.forget()
            return None
        if self._last and self._differ(terms, self._last[-1]):
            self._last.clear()
        self._last.append(terms)
        values = np.mean([one.values for one in self._last], axis=0)
        noise_px = terms.noise_px * np.sqrt(1.0 / len(self._last) + 1.0 / self._frames)
        return Terms(values, float(noise_px), terms.passing)

    @staticmethod
    def _differ(one: Terms, other: Terms) -> bool:
        """Whether two frames differ by more than noise."""
        change = float(np.linalg.norm(one.values - other.values))
        return bool(change > _SIGMAS * one.noise_px * np.sqrt(2.0 * len(one.values)))

    def _add(self, warp: Warp, rest_q: Float, whole: Terms) -> None:
        """Take in a frame that changes nothing; after some of them, choose the nodes to be looked at."""
        first = self._first
        if first is not None and (len(first.values) != len(whole.values) or self._differ(whole, first)):
            self.forget()
        if self._first is None or self._sum is None:
            self._first, self._sum = whole, np.zeros_like(warp.q)
        self._sum += warp.q
        self._valid = self._valid & warp.valid
        self._frames += 1
        if self._frames < REFERENCE_FRAMES:
            return
        self._sum /= self._frames
        nodes = self._flat(self._sum - rest_q)
        if np.count_nonzero(nodes) > max(_LEAST_SHARE * np.count_nonzero(self._visible), LEAST_NODES):
            fitter = MotionFitter(self._modes, self._grid, nodes)
            if fitter.amplification < _MOST_AMPLIFIED:
                self.fitter = fitter
                return
        self.forget()

    def _flat(self, displaced: Float) -> Mask:
        """Nodes (rows, cols) at which a displacement, LCD px, stretches the warp little."""
        stretch = np.abs(jacobian(displaced, self._grid.spacing_px)).max(axis=(-1, -2))
        bending = self._modes.camera_px * stretch
        nodes: Mask = self._valid & (np.nan_to_num(bending, nan=np.inf) < MOST_BENT)
        return nodes
