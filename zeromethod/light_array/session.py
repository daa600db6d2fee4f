"""A run of arrays as a person starts it: loop, recording, publisher, and the figures at its end."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any, cast

import numpy as np

from zeromethod.arrays import Float
from zeromethod.light_array.devices import Counts, LightArrays, open_arrays
from zeromethod.light_array.loop import READ_EVERY, LightLoop, LightStep
from zeromethod.light_array.rig import LightArrayRig
from zeromethod.light_array.simulated import SimulatedArrays
from zeromethod.loop.state import State
from zeromethod.loop.step import Step
from zeromethod.publishing.publisher import Publisher

COMPARED = frozenset({"hold", "slide"})
_COMPARE_EVERY = 20
"""Readings of depth to one that is compared with the truth of a simulated bench."""

_KEPT = 200_000
"""Readings of depth that the figures keep."""


class ArraysClock:
    """The arrays' clock, as far as readings have given it."""

    def __init__(self) -> None:
        self.time_ns = 0

    def now_ns(self) -> int:
        """Time of the newest readings."""
        return self.time_ns

    def sleep_until_ns(self, time_ns: int) -> None:
        """Nothing: this clock goes with the readings alone."""


class LightSession:
    """Iterate `run` for its steps, then close. history: s, peak, sigma (mm), residual of readings of depth.

    pressed: levels, modes and step where the peak was greatest.
    """

    def __init__(self, rig: LightArrayRig, publish: str | None = None, record: Path | None = None) -> None:
        self.rig = rig
        with ExitStack() as stack:
            arrays: LightArrays = open_arrays(rig)
            stack.callback(self._close)
            self._arrays = arrays
            self._truth = arrays if isinstance(arrays, SimulatedArrays) else None
            self.recording = None
            if record is not None:
                from zeromethod.light_array.recording import RecordedArrays  # noqa: PLC0415 - h5py loads slowly

                self.recording = self._arrays = RecordedArrays(arrays, record, rig)
            self.clock = ArraysClock()
            self._publisher = None if publish is None else stack.enter_context(Publisher(publish, self.clock))
            self.loop = LightLoop(rig, self._arrays)
            self._closing = stack.pop_all()
        self.address = "" if self._publisher is None else self._publisher.address
        self.interrupted = False
        self.last: LightStep | None = None
        self.history: list[tuple[float, float, float, float]] = []
        self.pressed: tuple[Counts, Float, LightStep] | None = None
        self._loop_ms: list[float] = []
        self._errors: list[tuple[float, float, float]] = []
        self._untouched: list[Float] = []
        self._hold_residual: list[float] = []

    def _close(self) -> None:
        self._arrays.close()

    def __enter__(self) -> LightSession:
        return self

    def __exit__(self, *exception: object) -> None:
        self._closing.__exit__(None, None, None)

    def interrupt(self) -> None:
        """End the run in order, from a signal handler."""
        self.interrupted = True
        self.loop.stop()

    def seconds(self, frames: int | None, seconds: float | None) -> float | None:
        """How long the run lasts: as asked, as the scenario; None: until it is stopped."""
        if frames is None and seconds is None and self._truth is not None:
            return self._truth.scenario.duration_s + self.rig.simulation.begin_s
        return seconds

    def run(self, frames: int | None, seconds: float | None) -> Iterator[LightStep]:
        """Run the loop; steps as they come."""
        for step in self.loop.run(frames, self.seconds(frames, seconds)):
            self.last = step
            self.clock.time_ns = step.time_ns
            if np.isfinite(step.loop_ms):
                self._loop_ms.append(step.loop_ms)
            if step.modes is not None:
                self._keep(step)
            if self.recording is not None:
                self.recording.add(step)
            if self._publisher is not None and (step.surface is not None or step.counts is None):
                # a step of arrays has all that a message takes of a camera's
                self._publisher.publish(cast("Step", step))
            yield step

    def _keep(self, step: LightStep) -> None:
        assert step.peak is not None
        assert step.modes is not None
        if len(self.history) < _KEPT:
            self.history.append((step.time_s, step.peak.depth_mm, step.peak.sigma_mm, step.light_residual))
        if self.pressed is None or abs(step.peak.depth_mm) >= abs(self.pressed[2].depth_peak_mm):
            assert step.shown is not None
            self.pressed = (step.shown, step.modes, step)
        if step.phase == "untouched" and len(self._untouched) < _KEPT:
            self._untouched.append(step.modes)
        if step.phase in COMPARED and step.state is State.LOCKED and self._truth is not None:
            self._hold_residual.append(step.light_residual)
            if len(self.history) % _COMPARE_EVERY == 0:
                self._errors.append(self._compared(step))

    def _compared(self, step: LightStep) -> tuple[float, float, float]:
        """Peak's error, of the true one; the same in its sigmas; rms error of depth over the view, mm."""
        assert self._truth is not None
        assert step.modes is not None
        assert step.peak is not None
        x, y, depth = self.loop.reader.depth_map(step.modes)
        mirror = self._truth.true_mirror(step.time_ns)
        true, peak = mirror.field(*np.meshgrid(x, y))[0], mirror.peak(x, y)
        error = step.peak.depth_mm - peak
        return error / peak, error / step.peak.sigma_mm, float(np.sqrt(np.mean((depth - true) ** 2)))

    def true_depth(self, step: LightStep, x: Float, y: Float) -> Float | None:
        """Depth of a simulated mirror at points, mm, at a step; None of a real one."""
        return None if self._truth is None else self._truth.true_mirror(step.time_ns).field(x, y)[0]

    @property
    def figures(self) -> dict[str, Any]:
        """All figures of the run so far, as --summary writes them."""
        last, loop = self.last, self.loop
        ms = np.array(self._loop_ms)
        peak = None if last is None or not self.history else self.history[-1]
        figures: dict[str, Any] = {
            "rig": self.rig.name,
            "state": None if last is None else last.state.value,
            "reason": "" if last is None else last.reason,
            "frames": len(self._loop_ms),
            "dropped": loop.counts["readings lost"],
            "readings_of_depth": len(self.history),
            "reading_hz": self.rig.detectors.rate_hz / READ_EVERY,
            "modes": self.rig.reading.modes,
            "depth_peak_mm": None if peak is None else peak[1],
            "depth_peak_sigma_mm": None if peak is None else peak[2],
            "light_residual": None if last is None or np.isnan(last.light_residual) else last.light_residual,
            "loop_ms": {"median": float(np.median(ms)), "p99": float(np.percentile(ms, 99))}
            if len(ms)
            else None,
            "computing_hz": float(1e3 / np.median(ms)) if len(ms) else None,
            "faults": loop.faults,
            "events": dict(loop.counts),
        }
        if len(self._untouched) > 1:
            depth = loop.reader.depth_of(np.array(self._untouched))
            figures["untouched_rms_um"] = 1e3 * float(np.sqrt(np.mean(depth**2)))
        if self._errors:
            errors = np.array(self._errors)
            worst = errors[np.argmax(np.abs(errors[:, 0]))]
            figures["truth"] = {
                "depth_peak_error_percent": 100 * float(worst[0]),
                "depth_peak_error_sigmas": float(worst[1]),
                "depth_rms_error_um": 1e3 * float(np.median(errors[:, 2])),
            }
            figures["light_residual_pressed"] = float(np.median(self._hold_residual))
        return figures
