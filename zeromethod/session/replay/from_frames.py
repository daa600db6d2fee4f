"""Replay from recorded frames: sensing, pairing and control by the loop's own circle, without devices."""

from __future__ import annotations

import json
import math
from collections import defaultdict
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from zeromethod.errors import InputError
from zeromethod.loop.assembly import make_circle
from zeromethod.loop.call import DONE
from zeromethod.loop.circle import Circle, FrameResult
from zeromethod.loop.state import State, sees_target
from zeromethod.optics import Optics
from zeromethod.recording.recording import Recording
from zeromethod.rig.model import Rig
from zeromethod.session.replay.differences import DepthDifferences, Figures, Spread, same
from zeromethod.session.replay.fine import FineDifferences, FineReplay
from zeromethod.session.replay.from_warps import Reader, grid_for
from zeromethod.session.replay.window import Pace, Window
from zeromethod.warp.warp import Warp


@dataclass
class WarpDifferences:
    """Replayed warps, commands and residuals against recorded ones.

    warps_damaged: recorded ones that are damaged and cannot be compared.
    """

    recording: Recording
    steps: int = 0
    different: list[int] = field(default_factory=list)
    warp: Spread = field(default_factory=Spread)
    commanded: Spread = field(default_factory=Spread)
    residual: Spread = field(default_factory=Spread)
    warps_damaged: int = 0
    _pairs: defaultdict[str, list[tuple[float, float]]] = field(default_factory=lambda: defaultdict(list))

    def add(self, row: Any, taken: FrameResult, measured: Warp | None, circle: Circle) -> None:
        """Take in one step. measured: from the session's zero; None where the frame is not believed."""
        step = int(row["number"])
        equal = self._same_measured(step, measured)
        commanded = self.recording.commanded(step)
        if commanded is not None:
            equal &= same(commanded, circle.commanded.q)
            self.commanded.add(circle.commanded.q.astype(np.float32) - commanded)
        equal &= self._same_seen(step, taken)
        for name in ("residual_rms_px", "valid_share"):
            pair = float(row[name]), float(getattr(taken, name))
            equal &= same(np.array(pair[0]), np.array(pair[1]))
            self._pairs[name].append(pair)
        self.steps += 1
        if not equal:
            self.different.append(step)

    def _same_measured(self, step: int, replayed: Warp | None) -> bool:
        recorded = self.recording.measured(step)
        if recorded is None and self.recording.is_damaged("warps/measured", step):
            self.warps_damaged += 1
            return replayed is not None
        if recorded is None or replayed is None:
            return recorded is None and replayed is None
        both = recorded.valid & replayed.valid
        self.warp.add((replayed.q - recorded.q)[both])
        if both.any():
            pair = float(np.median(recorded.sigma[both])), float(np.median(replayed.sigma[both]))
            self._pairs["sigma_lcd_px"].append(pair)
        names = ("q", "sigma", "flags")
        return all(same(getattr(recorded, name), getattr(replayed, name)) for name in names)

    def _same_seen(self, step: int, taken: FrameResult) -> bool:
        """Residual and the warp that was shown, as far as they were kept."""
        shown, residual = self.recording.shown(step), self.recording.residual(step)
        if taken.observation is None or taken.residual is None:
            return shown is None and residual is None
        equal = shown is None or same(shown, taken.observation.shown.q)
        if residual is None:
            return equal
        replayed = taken.residual
        both = residual.valid & replayed.valid
        self.residual.add((replayed.d.astype(np.float32) - residual.d)[both])
        for name in ("d", "sigma"):
            equal &= same(getattr(residual, name).astype(np.float32), getattr(replayed, name))
        return equal and same(residual.flags, replayed.flags) and same(residual.mean, replayed.mean)

    @property
    def figures(self) -> Figures:
        """JSON-ready. Medians over steps, recorded and replayed."""
        return {
            "steps": self.steps,
            "steps_equal": self.steps - len(self.different),
            "warps_damaged": self.warps_damaged,
            "first_different_step": self.different[0] if self.different else None,
            "measured_difference_lcd_px": self.warp.figures,
            "commanded_difference_lcd_px": self.commanded.figures,
            "residual_difference_px": self.residual.figures,
        } | {name: _medians(self._pairs[name]) for name in ("sigma_lcd_px", "residual_rms_px", "valid_share")}


def _medians(pairs: list[tuple[float, float]]) -> Figures:
    known = np.array([pair for pair in pairs if np.isfinite(pair).all()]).reshape(-1, 2)
    recorded, replayed = np.median(known, axis=0).tolist() if known.size else (None, None)
    return {"recorded": recorded, "replayed": replayed}


def _check(recording: Recording) -> None:
    for name in ("frames", "warps"):
        if name not in recording.kept:
            raise InputError(f"{recording.path}: recorded without {name}: it cannot be replayed from frames")
    if recording.every != 1:
        raise InputError(
            f"{recording.path}: only every {recording.every}th frame was kept: "
            "replay from frames follows the loop from frame to frame and needs them all"
        )


def replay_from_frames(
    recording: Recording,
    rig: Rig,
    window: Window,
    *,
    speed: float | None = None,
    on_step: Callable[[float], None] | None = None,
) -> tuple[WarpDifferences, DepthDifferences, FineDifferences]:
    """Process every frame that the session sensed, and read depth where it read it, fine surfaces, too.

    rig: the recording's, or with other settings. What was shown and when stays as recorded, and so does the
    reference frame of brightness. Steps before the window are processed too but not compared. on_step gets
    the seconds since the recording's start. Raises InputError for a recording without all of its frames and
    warps, and a rig whose camera or target is another one.
    """
    _check(recording)
    rest = recording.rest if grid_for(recording, rig) is recording.grid else None
    parts = make_circle(rig, Optics(rig), rest=rest)
    reader = Reader(recording, rig, parts.rest.grid)
    read = frozenset(recording.peaks["step"].tolist())
    warps, depths = WarpDifferences(recording), DepthDifferences(recording, window.start_ns)
    fine = FineReplay(recording, rig, parts.rest.grid)
    pace = Pace(speed)
    for row, taken in _taken(recording, parts.circle, window):
        if recording.state_of(row) is State.RESTING:
            parts.circle.learn_rest(taken)
        inside = int(row["time_ns"]) in window
        if inside:
            pace.wait_for(int(row["time_ns"]))
        step = int(row["number"])
        measured = taken.measured_from(recording.zero(step))
        if inside:
            warps.add(row, taken, measured, parts.circle)
        if measured is not None and step in read:
            surface, deepest = reader.read(step, measured)
            if inside:
                depths.add(step, surface, deepest)
        fine.add(row, taken, measured, inside)
        if on_step is not None:
            on_step(1e-9 * (int(row["time_ns"]) - window.start_ns))
    if not warps.steps:
        raise InputError(f"{recording.path}: no frame was sensed in this part: there is nothing to replay")
    return warps, depths, fine.differences


def _taken(recording: Recording, circle: Circle, window: Window) -> Iterator[tuple[Any, FrameResult]]:
    """Rows of the steps that reached the circle up to the window's end, and what it makes of them."""
    presentations, shown = recording.presentation_log, 0
    referenced, gains = False, _gains(recording)
    lost = min(recording.tables.damaged_steps("steps"), default=None)
    dark = recording.tables.first_unknown_picture()
    for row in recording.steps:
        if int(row["time_ns"]) > window.to_ns:
            return
        step = int(row["number"])
        if lost is not None and step > lost:
            raise InputError(_ends_at(recording, window, lost, f"the row of step {lost} is damaged"))
        if row["frame_number"] < 0:
            continue
        if dark is not None and step > dark:
            damage = f"what was shown before step {step} is damaged"
            raise InputError(_ends_at(recording, window, step, damage))
        while shown < len(presentations) and int(presentations["after_step"][shown]) < step:
            _present(recording, window, shown, circle)
            shown += 1
        taken = None
        if row["sensed"]:
            frame = recording.frame(step)
            if frame is None:
                why = "is damaged" if recording.is_damaged("frames", step) else "was not kept"
                at_s = 1e-9 * (int(row["time_ns"]) - window.start_ns)
                damage = f"the frame of step {step} ({at_s:.3f} s) {why}"
                raise InputError(_ends_at(recording, window, step, damage))
            for gain in gains.pop(step, ()):
                circle.controller.set_gain(gain)
            taken = circle.take(frame, bool(row["frozen"]))
        if not referenced and sees_target(recording.state_of(row), float(row["residual_rms_px"])):
            referenced = True
            if taken is not None:
                circle.take_reference(taken)
        if taken is not None:
            yield row, taken


def _gains(recording: Recording) -> dict[int, list[float]]:
    """Gains that were set during the run, by the step from which they held."""
    frames = recording.steps["number"][recording.steps["sensed"]]
    found: dict[int, list[float]] = {}
    for row in recording.tables.calls():
        if bytes(row["method"]) == b"gain" and bytes(row["outcome"]) == DONE.encode():
            at = int(np.searchsorted(frames, row["step"]))
            if at < len(frames):
                value = float(json.loads(row["arguments"])["value"])
                found.setdefault(int(frames[at]), []).append(value)
    return found


def _present(recording: Recording, window: Window, index: int, circle: Circle) -> None:
    """Hand the circle a picture: row `index` of the presentations."""
    row, q = recording.presentation_log[index], recording.picture_q(index)
    if q is None:
        why = "is damaged" if recording.is_damaged("pictures", index) else "was not kept"
        step = int(row["after_step"]) + 1
        raise InputError(_ends_at(recording, window, step, f"what was shown before step {step} {why}"))
    code, source_ns = int(row["strip_code"]), int(row["newest_frame_ns"])
    source = None if source_ns < 0 else source_ns
    coded = int(row["coded_picture"])
    # recordings made before targets moved have none
    shift = row["target_shift"].tolist() if "target_shift" in (row.dtype.names or ()) else (0.0, 0.0)
    circle.presented(
        int(row["time_ns"]),
        q,
        None if code < 0 else code,
        source_ns=source,
        coded=None if coded < 0 else coded,
        shift=shift,
    )


def _ends_at(recording: Recording, window: Window, step: int, why: str) -> str:
    """Message: why the replay cannot go on from a step on, and how far it can go."""
    steps = recording.steps
    before = steps["time_ns"][steps["sensed"] & (steps["number"] < step)]
    if not before.size:
        return f"{recording.path}: {why}: it cannot be replayed from frames"
    # rounded up, so that the last of them is within
    last_s = 1e-3 * math.ceil(1e-6 * (int(before[-1]) - window.start_ns))
    return f"{recording.path}: {why}: it can be replayed from frames up to there (--to {last_s:.3f})"
