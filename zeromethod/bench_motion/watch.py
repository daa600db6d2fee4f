"""Watch over the bench: whether camera, LCD or prism moved against each other since rest was taken.

The whole view: while nothing presses, all nodes must be where they were. A press looks like rigid motion in
part only. Known rest: of nodes that are at rest by declaration nothing but motion can move the picture.
"""

from __future__ import annotations

from collections import deque

import numpy as np

from zeromethod.arrays import Float, Mask
from zeromethod.bench_motion.fit import LEAST_NODES, UNLIKE, MotionFitter, Terms
from zeromethod.bench_motion.modes import BenchModes
from zeromethod.warp.grid import NodeGrid
from zeromethod.warp.warp import Warp

FRAMES = 8
"""Nulled frames whose mean is judged."""

LEAST_LCD_PX = 0.05
"""Motion of the whole view from which the bench counts as moved; less is drift, and in sigma."""

LEAST_KNOWN_LCD_PX = 0.02
"""The same of nodes known to rest, and from which `--follow-bench` corrects."""

_SIGMAS = 5.0
_PASSING = 0.98
"""Share of the nodes that must agree with rigid motion within their noise, or something presses."""

_MOST_AMPLIFIED = 5.0
"""Error over the view per error at the nodes known to rest, above which they do not fix the motion."""


class _Averaged:
    """Mean terms of the last frames of one fitter."""

    def __init__(self, modes: BenchModes, grid: NodeGrid, nodes: Mask) -> None:
        self.fitter: MotionFitter | None = None
        if np.count_nonzero(nodes) >= LEAST_NODES:
            self.fitter = MotionFitter(modes, grid, nodes)
        self._last: deque[Terms] = deque(maxlen=FRAMES)

    def add(self, warp: Warp, rest_q: Float) -> tuple[MotionFitter, Terms] | None:
        """The fitter, and the mean with this frame; None where too little of it is valid."""
        terms = None if self.fitter is None else self.fitter.fit(warp, rest_q)
        if self.fitter is None or terms is None:
            return None
        if self._last and len(terms.values) == len(self._last[-1].values):
            jump = float(np.linalg.norm(terms.values - self._last[-1].values))
            if jump > max(LEAST_LCD_PX, _SIGMAS * terms.noise_px * np.sqrt(2.0 * len(terms.values))):
                self._last.clear()
        self._last.append(terms)
        values = np.mean([one.values for one in self._last], axis=0)
        noise_px = float(np.sqrt(np.mean([one.noise_px**2 for one in self._last]) / len(self._last)))
        return self.fitter, Terms(values, noise_px, terms.passing)

    def forget(self) -> None:
        self._last.clear()


class BenchWatch:
    """Judges nulled frames one by one; once the bench has moved it stays so until `forget`.

    Parameters
    ----------
    modes : BenchModes
        What motion does to the warp.
    grid : NodeGrid
        The nodes.
    visible : (rows, cols) bool
        Nodes that are seen at rest.
    known : (rows, cols) bool
        Nodes known to be at rest whatever presses; with `places` the number of separate ones.
    places : int
        Of them; motion is distinguished from a press from two on.

    Attributes
    ----------
    moved : str
        By how much and what moved; "" as long as nothing did.
    motion : (modes,) array, optional
        The whole motion, LCD px, where the last frame shows it.
    drift : (modes,) array
        Motion as seen last while nothing pressed, noise taken off, LCD px.
    """

    def __init__(self, modes: BenchModes, grid: NodeGrid, visible: Mask, known: Mask, places: int) -> None:
        self.modes = modes
        self._view = _Averaged(modes, grid, visible)
        self._known = _Averaged(modes, grid, known & visible)
        fitter = self._known.fitter
        self._fixed = fitter is not None and places > 1 and fitter.amplification < _MOST_AMPLIFIED
        self.moved = ""
        self.motion: Float | None = None
        self.drift: Float = np.zeros(modes.count)
        self._largest_px = 0.0

    def look(self, warp: Warp, rest_q: Float) -> None:
        """Judge a nulled frame's warp against `rest_q`, (rows, cols, 2) LCD px."""
        self.motion = None
        view = self._view.add(warp, rest_q)
        if view is not None and view[1].passing > _PASSING:
            self._judge_view(*view)
        known = self._known.add(warp, rest_q)
        if known is not None:
            self._judge_known(*known)

    def _judge_view(self, fitter: MotionFitter, terms: Terms) -> None:
        noise2 = terms.noise_px**2
        motion2 = float(np.sum(terms.values[: fitter.count] ** 2))
        left2, free = float(np.sum(terms.values[fitter.count :] ** 2)), len(terms.values) - fitter.count
        beyond2, doubt2 = max(left2 - free * noise2, 0.0), 2.0 * np.sqrt(2.0 * free) * noise2
        rigid = beyond2 + doubt2 < UNLIKE**2 * motion2
        if rigid or beyond2 < 1.5 * doubt2:
            self.motion = fitter.motion(terms)
            # what noise does once in twenty times
            beyond = max(motion2 - (fitter.count + 2.0 * np.sqrt(2.0 * fitter.count)) * noise2, 0.0)
            self.drift = self.motion * np.sqrt(beyond / max(motion2, beyond, 1e-30))
        if rigid and motion2 > max(LEAST_LCD_PX, self._largest_px) ** 2:
            self._largest_px = float(np.sqrt(motion2))
            self.moved = f"the bench moved {self.modes.words(fitter.motion(terms))}"

    def _judge_known(self, fitter: MotionFitter, terms: Terms) -> None:
        moved_px = float(np.linalg.norm(terms.values[: fitter.count]))
        if moved_px < max(_SIGMAS * terms.noise_px * np.sqrt(fitter.count), LEAST_KNOWN_LCD_PX):
            return
        left_px = float(np.linalg.norm(terms.values[fitter.count :]))
        motion = fitter.motion(terms)
        rigid = left_px < UNLIKE * moved_px + _SIGMAS * terms.noise_px * np.sqrt(len(terms.values))
        if self._fixed and rigid and terms.passing > _PASSING:
            self.motion = motion
            words = f"the bench moved {self.modes.words(motion)}"
        else:
            words = f"the bench moved, or the rim is not at rest: {moved_px:.2g} LCD px where it should be"
        self.moved = self.moved or words

    @property
    def correction(self) -> Float | None:
        """Motion (modes,) LCD px to correct: known whole, and large enough."""
        if self.motion is None or not (self.moved or float(np.linalg.norm(self.drift)) > LEAST_KNOWN_LCD_PX):
            return None
        return self.motion

    def report(self, motion: Float, seen: Float) -> None:
        """Take in motion (modes,) LCD px found under a press, where only sums `seen` of modes show."""
        self.moved = self.moved or f"the bench moved at least {self.modes.words(motion, seen)}"

    def forget(self) -> None:
        """Begin again: rest was taken again, or the motion was corrected."""
        self._view.forget()
        self._known.forget()
        self.moved, self.motion, self._largest_px = "", None, 0.0
        self.drift = np.zeros(self.modes.count)
