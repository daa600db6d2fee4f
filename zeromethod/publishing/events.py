"""Contacts: when something touches the mirror and when it lets go, from readings alone."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np

from zeromethod.arrays import Mask
from zeromethod.contact import Contact
from zeromethod.surface import Peak, Surface

TOUCH_SIGMAS = 5.0
"""Depth of a touch in its own standard deviations. The highest of all nodes reaches 3.6 by noise."""

TOUCH_MM = 1e-3
"""Depth below which nothing is a touch, however low the noise: what temperature alone may do."""

TOUCH_NODES = 9
"""Nodes without light that are a touch without depth: 3 by 3, more than a speck within one node's window."""

TOUCH_FRAMES = 3
"""Consecutive readings that begin a touch, and that end it."""

_RELEASE = 0.8
"""Share of the limits below which a touch ends."""


@dataclass(frozen=True, slots=True)
class ContactEvent:
    """A touch that began or ended.

    number: events so far, this one included. time_ns: mid-exposure of the first frame with, or again
    without, the touch. x_mm, y_mm, depth_mm: of the deepest point (world frame; depth positive into the
    rubber), for "began" as just read, for "ended" where it was deepest during the touch. Where light is lost
    and there is no depth: the middle of the dark nodes, depth NaN.
    """

    number: int
    kind: Literal["began", "ended"]
    time_ns: int
    x_mm: float
    y_mm: float
    depth_mm: float


class _Place(NamedTuple):
    x_mm: float
    y_mm: float
    depth_mm: float


class ContactWatch:
    """Follows one touch, the deepest.

    What is in contact touches, from the reading that names it; what only presses touches, too: a reading
    shows a touch when its deepest point is at least max(5 sigma, 1 um) deep, or at least nine nodes that were
    read before have lost their light. Three consecutive such readings begin it; three below 0.8 of both
    limits, without a contact, end it. Frames that were not read count for neither; a bulge is no touch.
    """

    def __init__(self) -> None:
        self._touching = False
        self._number = 0
        self._consecutive = 0
        self._since_ns = 0
        self._deepest: _Place | None = None
        self._lit: Mask | None = None

    @property
    def touching(self) -> bool:
        """Whether a touch has begun and not ended."""
        return self._touching

    def update(
        self, surface: Surface, deepest: Peak, contacts: Sequence[Contact] = ()
    ) -> ContactEvent | None:
        """Take the next reading, its peak and its contacts; the event that it confirms, if any."""
        place = self._touched(surface, deepest, contacts)
        if place is not None:
            self._follow(place)
        if (place is not None) == self._touching:
            self._consecutive = 0
            return None
        if self._consecutive == 0:
            self._since_ns = surface.time_ns - round(1e9 * max((one.age_s for one in contacts), default=0.0))
        self._consecutive += 1
        if self._consecutive < TOUCH_FRAMES and not contacts:
            return None
        self._consecutive = 0
        self._touching = place is not None
        self._number += 1
        at = place or self._deepest
        assert at is not None
        kind: Literal["began", "ended"] = "began" if self._touching else "ended"
        return ContactEvent(self._number, kind, self._since_ns, *at)

    def _touched(self, surface: Surface, deepest: Peak, contacts: Sequence[Contact]) -> _Place | None:
        """Where a reading shows a touch, None where it shows none."""
        share = _RELEASE if self._touching else 1.0
        self._lit = surface.valid if self._lit is None else self._lit | surface.valid
        # Comparisons with NaN, where nothing was read, are False.
        if deepest.depth_mm >= share * max(TOUCH_SIGMAS * deepest.sigma_local_mm, TOUCH_MM):
            return _Place(deepest.x_mm, deepest.y_mm, deepest.depth_mm)
        if contacts:
            return _Place(contacts[0].x_mm, contacts[0].y_mm, float("nan"))
        # Some nodes may be dark at rest: only lit ones can lose their light.
        dark = surface.contact & self._lit & surface.on_mirror
        if np.count_nonzero(dark) < share * TOUCH_NODES:
            return None
        return _Place(float(surface.x_mm[dark].mean()), float(surface.y_mm[dark].mean()), float("nan"))

    def _follow(self, place: _Place) -> None:
        """Keep the deepest place of this touch, from the first reading that shows it."""
        kept = self._deepest
        begins = not self._touching and self._consecutive == 0
        # A place without depth gives way to one with, never the other way round.
        if kept is None or begins or np.isnan(kept.depth_mm) or place.depth_mm > kept.depth_mm:
            self._deepest = place
