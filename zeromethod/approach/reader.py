"""Reads frames of the watch camera: an approaching object, and when and where it will touch."""

from __future__ import annotations

from dataclasses import replace
from itertools import product

import numpy as np

from zeromethod.approach.approach import Approach, Watching
from zeromethod.approach.exits import exits_of
from zeromethod.approach.silhouettes import SOME, Background, Silhouette
from zeromethod.approach.spot import Spot, spot_of
from zeromethod.approach.track import MISSED_S, Track
from zeromethod.arrays import Float, Image
from zeromethod.errors import InputError
from zeromethod.optics.prism import PrismGeometry
from zeromethod.rig.model import Rig

LEAST_GREY = 8.0
"""Median light above black, in grey levels of 8 bits, below which the frame is too dark."""
ONE_PICTURE = "one thing in both halves of the frame, across their seam: the views of two lenses are needed"
CROSSED_MM = 30.0
"""Height at which it is decided whether the two views cross (`_over_seam`)."""
SAME_FRAMES = 4
"""After so many repeats, bit for bit, the camera is at fault: noise never repeats."""


class WatchReader:
    """Follows what comes, frame by frame.

    Raises InputError for a rig without a watch camera, or one that does not see through the mirror.
    """

    def __init__(self, rig: Rig) -> None:
        if rig.watch is None:
            raise InputError("watch: missing; the rig has no watch camera")
        self._scale = 2.0 ** (rig.watch.bits - 8)
        self._black_grey = rig.watch.noise.black_grey / self._scale
        self._shape = rig.watch.rows, rig.watch.columns
        self.exits = exits_of(rig, rig.watch, right=False), exits_of(rig, rig.watch, right=True)
        if min(exits.valid.mean() for exits in self.exits) < 0.05:
            key = "baseline_mm" if rig.watch.baseline_mm > rig.prism.width_mm else "look_at_mm"
            raise InputError(f"watch.{key}: hardly any ray of the watch camera goes out by the mirror")
        self._some = np.flatnonzero(np.hstack([exits.valid for exits in self.exits]))[::SOME]
        self._backgrounds = tuple(Background(exits.valid) for exits in self.exits)
        self._mirror = PrismGeometry(rig.prism)
        feet = [exits.foot[exits.valid].mean(axis=0) for exits in self.exits]
        self._middle: Float = np.mean(feet, axis=0)
        left, right = (
            (exits.foot + CROSSED_MM * exits.tangent)[exits.valid.any(axis=1)] for exits in self.exits
        )
        across = (left[:, -1] - left[:, 0]).mean(axis=0)
        self._crossed = float((left[:, -1] - right[:, 0]).mean(axis=0) @ across) > 0
        self._track: Track | None = None
        self._last: Image | None = None
        self._same = 0

    def take(self, image: Image, time_ns: int) -> Approach:
        """What comes, by a frame with mid-exposure `time_ns`."""
        if trouble := self._trouble(image):
            self._track = None
            return Approach(watching=Watching.BLIND, time_ns=time_ns, reason=trouble)
        grey = image.astype(np.float32) / np.float32(self._scale) - np.float32(self._black_grey)
        halves = np.split(grey, 2, axis=1)
        found = [one.look(half) for one, half in zip(self._backgrounds, halves, strict=True)]
        known = self._track.known if self._track is not None else None
        pairs = [(left, right) for left, right in product(*found) if left.darker == right.darker]
        apart = [pair for pair in pairs if not self._over_seam(*pair)]
        spots = [spot_of(self.exits, pair, known) for pair in apart]
        approach = self._follow([spot for spot in spots if spot is not None], time_ns, still_seen=bool(apart))
        if approach.watching is Watching.CLEAR and any(found):
            approach = replace(
                approach, watching=Watching.SEEN, reason=ONE_PICTURE if len(apart) < len(pairs) else ""
            )
        return replace(approach, watching=Watching.SEEN) if self._misses(approach) else approach

    def _over_seam(self, left: Silhouette, right: Silhouette) -> bool:
        """Whether a silhouette goes on from the left half into the right one, as in the view of one lens."""
        joined = left.cols.stop == self._shape[1] // 2 and right.cols.start == 0
        level = left.rows.start < right.rows.stop and right.rows.start < left.rows.stop
        return self._crossed and joined and level

    def _misses(self, approach: Approach) -> bool:
        """Whether all of what comes will miss the mirror."""
        if self._track is None or not approach.armed:
            return False
        place = np.array([approach.x_mm, approach.y_mm])
        inwards = self._middle - place
        inwards *= min(self._track.newest.flat.reach_mm / max(float(np.hypot(*inwards)), 1e-9), 1.0)
        return not self._mirror.on_mirror(*(place + inwards))

    def _follow(self, spots: list[Spot], time_ns: int, *, still_seen: bool) -> Approach:
        track = self._track
        missed_ns = 0 if track is None else time_ns - track.time_ns
        if track is not None and missed_ns < 1e9 * track.kept_s(still_seen=still_seen):
            nearest = min(spots, key=track.off_mm, default=None)
            if nearest is not None and track.fits(time_ns, nearest):
                track.add(time_ns, nearest)
                return track.approach()
            if not spots or missed_ns < 1e9 * MISSED_S:
                return track.missed(time_ns)
        self._track = None
        if not spots:
            return Approach(watching=Watching.CLEAR, time_ns=time_ns)
        self._track = Track(time_ns, min(spots, key=lambda spot: float(spot.flat.place[2])))
        return self._track.approach()

    def _trouble(self, image: Image) -> str:
        """Why a frame cannot be used; "" where it can."""
        if image.shape != self._shape:
            return f"frames of {image.shape} (rows, columns), the rig says {self._shape}"
        same = self._last is not None and np.array_equal(image, self._last)
        self._same, self._last = (self._same + 1 if same else 0), image
        if self._same >= SAME_FRAMES:
            return "the same picture again and again"
        middle = float(np.median(image.ravel()[self._some])) / self._scale
        if middle - self._black_grey < LEAST_GREY:
            return "too dark"
        return "too bright" if middle >= 254 else ""
