"""Watch over the bench: whether camera, LCD or prism moved against each other since rest was taken.

The whole view: while nothing presses, all nodes must be where they were. A press looks like rigid motion in
part only. A press that is held: what changes meanwhile, over all that it bends little, is no press. Known
rest: of nodes that are at rest by declaration nothing but motion can move the picture.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np

from zeromethod.arrays import Float, Mask
from zeromethod.bench_motion.fit import LEAST_NODES, UNLIKE, MotionFitter, Terms
from zeromethod.bench_motion.held import HELD_FRAMES, HeldPress
from zeromethod.bench_motion.modes import BenchModes
from zeromethod.warp.grid import NodeGrid
from zeromethod.warp.warp import Warp

FRAMES = 8
"""Nulled frames whose mean is judged."""

LEAST_LCD_PX = 0.05
"""Motion of the whole view from which the bench counts as moved; less is drift, and in sigma."""

LEAST_KNOWN_LCD_PX = 0.02
"""The same of nodes known to rest, and from which `--follow-bench` corrects."""

SIGMAS = 5.0
"""Standard deviations of noise from which on motion is seen."""
_PASSING = 0.98
"""Share of the nodes that must agree with rigid motion within their noise, or something presses."""

_PASSING_HELD = 0.9
"""The same under a held press: a camera that turned moves the press in the view as well."""

_SURE = 5.0
"""Motion over all else from which it stays in the drift when the press changes."""

_MOST_AMPLIFIED = 5.0
"""Error over the view per error at the nodes known to rest, above which they do not fix the motion."""


@dataclass(frozen=True, slots=True)
class _Found:
    """What terms say: size of the motion, LCD px, and motion with the noise's share taken off (modes,).

    left_px: most of what motion cannot do. rigid: that is little over the motion. alike: it may be noise.
    """

    motion_px: float
    left_px: float
    drift: Float
    rigid: bool
    alike: bool

    @classmethod
    def of(cls, fitter: MotionFitter, terms: Terms, fixed: Float | None) -> _Found:
        """Judge terms. fixed: sum (modes,) of length 1 that no motion has; None for none."""
        noise2, count = terms.noise_px**2, fitter.count
        motion2 = float(np.sum(terms.values[:count] ** 2))
        left2, free = float(np.sum(terms.values[count:] ** 2)), len(terms.values) - count
        motion = fitter.motion(terms)
        if fixed is not None:
            part2 = min(float(motion @ fixed) ** 2, motion2)
            motion2, left2, free = motion2 - part2, left2 + part2, free + 1
            motion = motion - (motion @ fixed) * fixed
        beyond2, doubt2 = max(left2 - free * noise2, 0.0), 2.0 * np.sqrt(2.0 * free) * noise2
        # what noise does once in twenty times
        beyond = max(motion2 - (count + 2.0 * np.sqrt(2.0 * count)) * noise2, 0.0)
        drift = motion * np.sqrt(beyond / max(motion2, beyond, 1e-30))
        moved_px, left_px = float(np.sqrt(motion2)), float(np.sqrt(beyond2 + doubt2))
        return cls(moved_px, left_px, drift, left_px < UNLIKE * moved_px, beyond2 < 1.5 * doubt2)


class _Averaged:
    """Mean terms of the last frames of one fitter."""

    def __init__(self, modes: BenchModes, grid: NodeGrid, nodes: Mask) -> None:
        self.fitter: MotionFitter | None = None
        if np.count_nonzero(nodes) >= LEAST_NODES:
            self.fitter = MotionFitter(modes, grid, nodes)
        self._last: deque[Terms] = deque(maxlen=FRAMES)

    def add(self, warp: Warp, rest_q: Float) -> tuple[MotionFitter, Terms, Terms] | None:
        """The fitter, the mean with this frame, and the frame's own; None where too little of it is valid."""
        terms = None if self.fitter is None else self.fitter.fit(warp, rest_q)
        if self.fitter is None or terms is None:
            return None
        if self._last and len(terms.values) == len(self._last[-1].values):
            jump = float(np.linalg.norm(terms.values - self._last[-1].values))
            if jump > max(LEAST_LCD_PX, SIGMAS * terms.noise_px * np.sqrt(2.0 * len(terms.values))):
                self._last.clear()
        self._last.append(terms)
        values = np.mean([one.values for one in self._last], axis=0)
        noise_px = float(np.sqrt(np.mean([one.noise_px**2 for one in self._last]) / len(self._last)))
        return self.fitter, Terms(values, noise_px, terms.passing), terms

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
        Motion as seen last while nothing pressed, and while a press was held since, noise taken off, LCD px.
    """

    def __init__(self, modes: BenchModes, grid: NodeGrid, visible: Mask, known: Mask, places: int) -> None:
        self.modes = modes
        self._view = _Averaged(modes, grid, visible)
        self._press = HeldPress(modes, grid, visible)
        self._before: Float = np.zeros(modes.count)
        self._sure = self._before
        self._known = _Averaged(modes, grid, known & visible)
        fitter = self._known.fitter
        self._fixed = fitter is not None and places > 1 and fitter.amplification < _MOST_AMPLIFIED
        self.moved = ""
        self.motion: Float | None = None
        self.drift: Float = np.zeros(modes.count)
        self._largest_px = 0.0
        # a scale is as it is: once the mirror was seen as the rig file says, only a press looks like another
        self._fixed_scale: Float | None = None

    def look(self, warp: Warp, rest_q: Float) -> None:
        """Judge a nulled frame's warp against `rest_q`, (rows, cols, 2) LCD px."""
        self.motion = None
        view = self._view.add(warp, rest_q)
        if view is not None:
            fitter, terms, newest = view
            if not (terms.passing > _PASSING and self._judge_view(fitter, terms)):
                self._judge_held(warp, rest_q, newest)
        known = self._known.add(warp, rest_q)
        if known is not None:
            self._judge_known(*known[:2])

    def _judge_view(self, fitter: MotionFitter, terms: Terms) -> bool:
        """Judge the whole view; whether nothing presses."""
        found = _Found.of(fitter, terms, self._fixed_scale)
        if found.rigid or found.alike:
            self.motion = fitter.motion(terms)
            self.drift = self._before = self._sure = found.drift
            self._press.forget()
            self._fixed_scale = self.modes.scale if found.alike else self._fixed_scale
        if found.rigid and found.motion_px > max(LEAST_LCD_PX, self._largest_px):
            self._largest_px = found.motion_px
            self.moved = f"the bench moved {self.modes.words(fitter.motion(terms))}"
        return found.rigid or found.alike

    def _judge_held(self, warp: Warp, rest_q: Float, whole: Terms) -> None:
        """Judge what has moved while a press is held."""
        press = self._press
        terms, fitter = press.look(warp, rest_q, whole), press.fitter
        if terms is None or fitter is None:
            return
        found = _Found.of(fitter, terms, self._fixed_scale)
        if not (terms.passing > _PASSING_HELD and (found.rigid or found.alike)):
            # the press has changed; what was no press before stays
            press.forget()
            self.drift = self._before = self._sure
            return
        self.drift = self._before + found.drift
        if found.motion_px > _SURE * found.left_px:
            self._sure = self.drift
        moves = found.rigid and found.motion_px > LEAST_LCD_PX
        press.moving_frames = press.moving_frames + 1 if moves else 0
        if moves and (press.settled or press.moving_frames >= HELD_FRAMES) and not self.moved:
            self.moved = f"the bench moved {self.modes.words(fitter.motion(terms))}"

    def _judge_known(self, fitter: MotionFitter, terms: Terms) -> None:
        moved_px = float(np.linalg.norm(terms.values[: fitter.count]))
        if moved_px < max(SIGMAS * terms.noise_px * np.sqrt(fitter.count), LEAST_KNOWN_LCD_PX):
            return
        left_px = float(np.linalg.norm(terms.values[fitter.count :]))
        motion = fitter.motion(terms)
        rigid = left_px < UNLIKE * moved_px + SIGMAS * terms.noise_px * np.sqrt(len(terms.values))
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

    def report(self, motion: Float, seen: Float, teeth: str = "") -> None:
        """Take in motion (modes,) LCD px found under a press, where only sums `seen` of modes show.

        teeth: what was found instead of a saw that differs from the rig file.
        """
        words = teeth or f"the bench moved at least {self.modes.words(motion, seen)}"
        self.moved = self.moved or words

    def forget(self) -> None:
        """Begin again: rest was taken again, or the motion was corrected."""
        self._view.forget()
        self._known.forget()
        self._press.forget()
        self.moved, self.motion, self._largest_px = "", None, 0.0
        self.drift = self._before = self._sure = np.zeros(self.modes.count)
