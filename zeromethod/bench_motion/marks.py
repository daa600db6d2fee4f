"""Watch over marks on the prism's frame that the camera sees itself: what presses does not move them."""

from __future__ import annotations

from collections import deque

import numpy as np

from zeromethod.arrays import Float, Image, Mask
from zeromethod.bench_motion.mark import MOST_SIGMA_PX, Mark, SeenMark
from zeromethod.bench_motion.watch import FRAMES, LEAST_LCD_PX
from zeromethod.errors import InputError
from zeromethod.rig.model import MARK_HALF_PX, Rig
from zeromethod.warp.grid import NodeGrid

_SIGMAS = 5.0
"""Standard deviations of a mark's place from which on it has moved."""
_LEAST_FRAMES = 4
"""Frames of one mark from which it is judged: fewer can be a hand that passes."""

_FROM_MEDIAN, _OF_MEDIAN = 1.05, 1.25
"""Sigma over the median of absolute differences of two; sigma of a median over that of a mean."""

_Places = tuple[tuple[int, int], ...]


def apart_px(grid: NodeGrid) -> int:
    """Least distance, camera px along u or v, of a mark from a node that is measured."""
    # a node is visible one period inside the LCD's picture; its own window is one wide
    return MARK_HALF_PX + 2 * grid.period_px


def mark_places(rig: Rig, grid: NodeGrid, visible: Mask) -> _Places:
    """Columns and rows of a rig's marks; raises InputError for one too near to `visible` nodes."""
    apart = apart_px(grid)
    u, v = (one[visible] for one in grid.mesh())
    for place in rig.surface.marks_px:
        if np.any((np.abs(u - place[0]) <= apart) & (np.abs(v - place[1]) <= apart)):
            raise InputError(
                f"rig: surface.marks_px: {list(place)}: {apart} px or more from all that is measured"
            )
    return tuple((round(u_px), round(v_px)) for u_px, v_px in rig.surface.marks_px)


class MarkWatch:
    """Judges the marks frame by frame; once one has moved the camera has, until `forget`.

    Parameters
    ----------
    places : tuple of (int, int)
        Columns and rows of the marks.
    camera_px : float
        Camera px per LCD px.

    Attributes
    ----------
    moved : str
        By how much the camera moved against the prism; "" as long as it did not.
    """

    def __init__(self, places: _Places, camera_px: float) -> None:
        self._places = places
        self._least_px = LEAST_LCD_PX * camera_px
        self._said: set[str] = set()
        self.forget()

    def forget(self) -> None:
        """Begin again: rest was taken again."""
        self.moved = ""
        self._gathered: list[list[Float]] = []
        self._marks: list[Mark | None] = []
        self._seen: list[deque[SeenMark]] = [deque(maxlen=FRAMES) for _ in self._places]
        self._frames = 0

    def look(self, image: Image, nulled: bool) -> str:
        """Take in a frame; what is to be said of the marks themselves, once, else "".

        The first `FRAMES` frames that are nulled are where the marks belong.
        """
        if not self._marks:
            return self._gather(image) if nulled else ""
        self._frames += 1
        lost: list[Mark] = []
        for mark, seen in zip(self._marks, self._seen, strict=True):
            found = None if mark is None else mark.see(image)
            if found is not None:
                seen.append(found)
            elif mark is not None:
                seen.clear()
                lost.append(mark)
        if lost:
            lost[self._frames % len(lost)].search(image)
        self._judge()
        return ""

    def _gather(self, image: Image) -> str:
        self._gathered.append([Mark.window(image, *place) for place in self._places])
        if len(self._gathered) < FRAMES:
            return ""
        faint = []
        for place, windows in zip(self._places, zip(*self._gathered, strict=True), strict=True):
            mark = Mark(*place, np.stack(windows))
            self._marks.append(mark if mark.sigma_px < MOST_SIGMA_PX else None)
            if self._marks[-1] is None:
                faint.append(f"({place[0]}, {place[1]})")
        self._gathered.clear()
        words = f"not watched, too little contrast: the mark at {', '.join(faint)} px" if faint else ""
        if words in self._said:
            return ""
        self._said.add(words)
        return words

    def _judge(self) -> None:
        far = (one[-1].shift_px for one in self._seen if len(one) >= _LEAST_FRAMES)
        if self.moved or not any(u_px**2 + v_px**2 > self._least_px**2 for u_px, v_px in far):
            return
        shifts, now, least = [], [], []
        for mark, seen in zip(self._marks, self._seen, strict=True):
            if mark is None or len(seen) < _LEAST_FRAMES:
                continue
            places = np.array([one.shift_px for one in seen])
            # medians pass over single frames; that of the differences over the jump, which is no noise
            scatter_px = float(np.median(np.abs(np.diff(places, axis=0)), axis=0).max()) * _FROM_MEDIAN
            sigma_px = _OF_MEDIAN * max(scatter_px, mark.sigma_px) / np.sqrt(len(seen))
            shifts.append(np.median(places, axis=0))
            now.append(np.median(places[-_LEAST_FRAMES:], axis=0))
            feigned_px = float(np.median([one.feigned_px for one in seen]))
            least.append(max(_SIGMAS * sigma_px, self._least_px) + feigned_px)
        if not np.any(np.hypot(*np.transpose(shifts)) > least):
            return
        self.moved = f"camera against prism moved by {np.hypot(*np.transpose(now)).max():.2g} px (marks)"
        if np.any(np.hypot(*np.transpose(now - np.mean(now, axis=0))) > least):
            self.moved += ", not all alike: rolled, or nearer or farther"
