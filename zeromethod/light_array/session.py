"""A run of arrays as a person starts it: loop, recording, publisher, and the figures at its end."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from contextlib import ExitStack, closing
from pathlib import Path
from typing import Any, cast

import numpy as np

from zeromethod.arrays import Float
from zeromethod.clock import SimulatedClock
from zeromethod.light_array.exchange import no_record
from zeromethod.light_array.link import LinkedArrays
from zeromethod.light_array.loop import READ_EVERY, LightLoop, LightStep
from zeromethod.light_array.recording import Recorder
from zeromethod.light_array.rig import LightArrayRig
from zeromethod.light_array.simulated import SimulatedArrays
from zeromethod.loop.state import State
from zeromethod.loop.step import Step
from zeromethod.publishing.publisher import Publisher

_COMPARED_PHASES = frozenset({"hold", "slide"})
_COMPARE_EVERY = 20
"""Of so many readings of depth, one is compared with the truth of a simulated bench."""

_KEPT = 200_000
"""Newest readings of depth, or frames, that the figures are of."""


class ArraysClock(SimulatedClock):
    """The arrays' clock, as far as readings have given it; it goes back where the arrays start again."""

    def sleep_until_ns(self, time_ns: int) -> None:
        """Set the time."""
        self._now_ns = time_ns


class LightSession:
    """Iterate `run` for its steps, then close.

    history: time in s, peak and its sigma in mm, of readings of depth. pressed: the step with the greatest
    peak, where one was read.
    """

    def __init__(self, rig: LightArrayRig, publish: str | None = None, record: Path | None = None) -> None:
        self.rig, self.clock, recorded = rig, ArraysClock(), no_record
        with ExitStack() as stack:
            address = rig.arrays.address
            self._truth = SimulatedArrays(rig) if address == "simulated" else None
            arrays = stack.enter_context(closing(self._truth or LinkedArrays(address)))
            if record is not None:
                recorded = stack.enter_context(closing(Recorder(record, rig))).add
            self._publisher = None if publish is None else stack.enter_context(Publisher(publish, self.clock))
            self.loop = LightLoop(rig, arrays, recorded)
            self._closing = stack.pop_all()
        self.address = "" if self._publisher is None else self._publisher.address
        self.interrupted = False
        self.last: LightStep | None = None
        self.pressed: LightStep | None = None
        self.history: deque[tuple[float, float, float]] = deque(maxlen=_KEPT)
        self._frames = self._readings = 0
        self._loop_ms: deque[float] = deque(maxlen=_KEPT)
        self._untouched: deque[Float] = deque(maxlen=_KEPT)
        self._pressed_residuals: list[float] = []
        self._errors: list[tuple[float, float, float]] = []

    def __enter__(self) -> LightSession:
        return self

    def __exit__(self, *exception: object) -> None:
        self._closing.close()

    def interrupt(self) -> None:
        """End the run in order, from a signal handler."""
        self.interrupted = True
        self.loop.stop()

    def seconds(self, frames: int | None, seconds: float | None) -> float | None:
        """How long the run lasts: as asked, or as its scenario; None: until it is stopped."""
        if frames is None and seconds is None and self._truth is not None:
            return self._truth.scenario.duration_s + self.rig.simulation.begin_s
        return seconds

    def run(self, frames: int | None, seconds: float | None) -> Iterator[LightStep]:
        """Run the loop; steps as they come."""
        for step in self.loop.run(frames, self.seconds(frames, seconds)):
            self.last = step
            self.clock.sleep_until_ns(step.time_ns)
            if step.sensed:
                self._frames += 1
                self._loop_ms.append(step.loop_ms)
            self._keep(step)
            if self._publisher is not None and (step.surface is not None or step.counts is None):
                # a step of arrays has all that a message takes of a camera's
                self._publisher.publish(cast("Step", step))
            yield step

    def _keep(self, step: LightStep) -> None:
        """Take a reading of depth into the figures."""
        modes, peak = step.modes, step.peak
        if modes is None or peak is None:
            return
        self._readings += 1
        self.history.append((step.time_s, peak.depth_mm, peak.sigma_mm))
        if self.pressed is None or abs(peak.depth_mm) >= abs(self.pressed.depth_peak_mm):
            self.pressed = step
        if step.phase == "untouched":
            self._untouched.append(modes)
        if step.phase in _COMPARED_PHASES and step.state is State.LOCKED and self._truth is not None:
            self._pressed_residuals.append(step.light_residual)
            if self._readings % _COMPARE_EVERY == 0:
                x, y, depth = self.loop.reader.depth_map(modes)
                mirror = self._truth.true_mirror(step.time_ns)
                true, true_peak = mirror.field(*np.meshgrid(x, y))[0], mirror.peak(x, y)
                error, rms = peak.depth_mm - true_peak, float(np.sqrt(np.mean((depth - true) ** 2)))
                self._errors.append((error / true_peak, error / peak.sigma_mm, rms))

    def true_depth(self, step: LightStep, x: Float, y: Float) -> Float | None:
        """Depth of a simulated mirror at points, mm, at a step; None of a real one."""
        return None if self._truth is None else self._truth.true_mirror(step.time_ns).field(x, y)[0]

    @property
    def figures(self) -> dict[str, Any]:
        """All figures of the run so far, as --summary writes them."""
        last, loop, ms = self.last, self.loop, np.array(self._loop_ms)
        _, peak_mm, sigma_mm = self.history[-1] if self.history else (None, None, None)
        median_ms, p99_ms = np.percentile(ms, [50, 99]).tolist() if len(ms) else (None, None)
        figures: dict[str, Any] = {
            "rig": self.rig.name,
            "state": None if last is None else last.state.value,
            "reason": "" if last is None else last.reason,
            "frames": self._frames,
            "dropped": loop.counts["readings lost"],
            "readings_of_depth": self._readings,
            "reading_hz": self.rig.detectors.rate_hz / READ_EVERY,
            "modes": self.rig.reading.modes,
            "depth_peak_mm": peak_mm,
            "depth_peak_sigma_mm": sigma_mm,
            "light_residual": None if last is None or np.isnan(last.light_residual) else last.light_residual,
            "loop_ms": {"median": median_ms, "p99": p99_ms} if median_ms else None,
            "computing_hz": 1e3 / median_ms if median_ms else None,
            "faults": loop.faults,
            "events": dict(loop.counts),
        }
        if self.pressed is not None and (peak := self.pressed.peak) is not None:
            place = {"x_mm": peak.x_mm, "y_mm": peak.y_mm, "time_s": self.pressed.time_s}
            figures["deepest"] = {"depth_mm": peak.depth_mm, "sigma_mm": peak.sigma_mm, **place}
        if len(self._untouched) > 1:
            depth = loop.reader.depth_of(np.array(self._untouched))
            figures["untouched_rms_um"] = 1e3 * float(np.sqrt(np.mean(depth**2)))
        if self._errors:
            errors = np.array(self._errors)
            peak_error, in_sigmas, _ = errors[np.argmax(np.abs(errors[:, 0]))]
            figures["truth"] = {
                "depth_peak_error_percent": 100 * float(peak_error),
                "depth_peak_error_sigmas": float(in_sigmas),
                "depth_rms_error_um": 1e3 * float(np.median(errors[:, 2])),
            }
            figures["light_residual_pressed"] = float(np.median(self._pressed_residuals))
        return figures
