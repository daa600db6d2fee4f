"""Doubt in the bench: what the loop does about camera, LCD or prism that moved since rest was taken."""

from __future__ import annotations

import numpy as np

from zeromethod.arrays import Image
from zeromethod.bench_motion.fit import LEAST_NODES
from zeromethod.bench_motion.marks import MarkWatch, mark_places
from zeromethod.bench_motion.modes import BenchModes
from zeromethod.bench_motion.watch import BenchWatch
from zeromethod.loop.circle import FrameResult
from zeromethod.loop.events import Event, Notice
from zeromethod.loop.state import LOCK_RESIDUAL_PX, Doubt, State
from zeromethod.loop.zero import Zero
from zeromethod.optics import Optics
from zeromethod.rig.model import Rig
from zeromethod.surface.anchor import known_nodes
from zeromethod.surface.curl import Curl
from zeromethod.warp.rest import Rest
from zeromethod.warp.warp import Warp


def make_watch(rig: Rig, optics: Optics, rest: Rest) -> BenchWatch:
    """Make the watch over a rig's bench, tried with a made-up warp."""
    point = optics.trace(*rest.grid.mesh(), optics.rest).point
    places = [known_nodes([one], point[..., 0], point[..., 1]) for one in rig.surface.known_rest]
    places = [one for one in places if np.count_nonzero(one & rest.visible) >= LEAST_NODES]
    known = np.logical_or.reduce([np.zeros(rest.grid.shape, bool), *places])
    modes = BenchModes.of(optics, rest.grid)
    watch = BenchWatch(modes, rest.grid, rest.visible, known, len(places))
    watch.look(Warp(rest.q, np.full_like(rest.q, 0.01), rest.flags, 0), rest.q)
    watch.forget()
    return watch


class BenchDoubt:
    """Whether the bench moved, until the zero is taken again or, where the rig says so, corrected."""

    def __init__(self, rig: Rig, optics: Optics, rest: Rest, zero: Zero, watches: bool) -> None:
        """Watch nothing where not `watches`: then nothing is ever in doubt."""
        self._watch = make_watch(rig, optics, rest) if watches else None
        places = mark_places(rig, rest.grid, rest.visible)
        self._marks = MarkWatch(places, self._watch.modes.camera_px) if self._watch and places else None
        self._zero = zero
        # a pattern that stays is never nulled: what it reads is as good far from its null
        self._most_px = float("inf") if rig.control.passive else LOCK_RESIDUAL_PX
        self._nodes = rest.grid.mesh() if rig.control.follow_bench else None
        self._from = zero.q
        self._since_ns = 0
        self._said = False

    @property
    def doubt(self) -> Doubt | None:
        """Why readings must not be trusted; None where they may."""
        moved = self._moved
        return Doubt(State.MOVED, moved) if moved else None

    @property
    def _moved(self) -> str:
        """What moved; of two watches, what the marks say, which is of camera and prism alone."""
        marks = "" if self._marks is None else self._marks.moved
        return marks or ("" if self._watch is None else self._watch.moved)

    def look(self, image: Image, result: FrameResult) -> tuple[Notice, ...]:
        """Judge a frame, its warp if it is nulled; news of a bench that moved or was followed."""
        watch, measured = self._watch, result.believed
        if watch is None:
            return ()
        nulled = measured is not None and result.residual_rms_px < self._most_px
        if measured is not None and self._zero.q is not self._from:
            self._forget(watch, measured.time_ns)
        words = "" if self._marks is None else self._marks.look(image, nulled)
        said = (Notice(Event.MARK_FAINT, words),) if words else ()
        if measured is None or not nulled:
            return said
        return said + self._judged(watch, measured)

    def _judged(self, watch: BenchWatch, measured: Warp) -> tuple[Notice, ...]:
        """News of a nulled frame."""
        watch.look(measured, self._zero.rest_q)
        motion = watch.correction
        if self._nodes is not None and motion is not None:
            self._zero.shift(watch.modes.at(*self._nodes) @ motion)
            self._forget(watch, measured.time_ns)
            words = f"readings follow the bench, moved {watch.modes.words(motion)}"
            return (Notice(Event.BENCH_FOLLOWED, words),)
        if self._said or not self._moved:
            return ()
        self._said = True
        return (Notice(Event.BENCH_MOVED, self._moved),)

    def report(self, curl: Curl, time_ns: int) -> None:
        """Take in what a reading of the frame at `time_ns` found under a press."""
        if self._watch is not None and time_ns >= self._since_ns:
            self._watch.report(curl.motion, curl.seen, curl.teeth)

    def _forget(self, watch: BenchWatch, time_ns: int) -> None:
        """Rest was taken again: what was found of frames before `time_ns` is over."""
        self._since_ns, self._said, self._from = time_ns, False, self._zero.q
        watch.forget()
        if self._marks is not None:
            self._marks.forget()
