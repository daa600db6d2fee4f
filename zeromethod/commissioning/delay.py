"""Measuring the delay between display and camera: coded pictures of the mirror at rest, one after the other.

What "the delay" is, is said once, in `zeromethod.exposure.delay`.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from zeromethod.commissioning.clock_phases import ClockPhases
from zeromethod.devices.abilities import poll_of
from zeromethod.devices.opening import Devices
from zeromethod.devices.protocols import CameraTimeout, Frame
from zeromethod.errors import MeasurementError
from zeromethod.exposure.delay import DelayWatch
from zeromethod.exposure.pairing import PanelTiming, pair
from zeromethod.exposure.presentation_log import PresentationLog
from zeromethod.exposure.strip_matching import Match
from zeromethod.exposure.strip_reading import StripReader, find_strips
from zeromethod.loop.drawing import Drawer
from zeromethod.optics import Optics
from zeromethod.pattern.strips import CODES
from zeromethod.rig.model import Rig
from zeromethod.warp.rest import Rest

DEFAULT_SECONDS, MOST_SECONDS = 3.0, 24.0
"""How long the delay is measured, and at most where the clocks must first drift: 59.95 and 60 Hz meet again
after 20 s."""

LEAST_FRAMES = 8
"""Frames with a delay of their own that a result needs."""

LOOSEST_REFRESHES = 0.3
"""Widest range of delays, in refreshes, whose middle is taken: noise is part of it, so that the middle is a
tenth of a refresh off at most."""

UNSTEADY_REFRESHES = 0.25
"""Scatter of single frames' delays, in refreshes, beyond which none of them is the bench's."""
WIDEST_REFRESHES = 2.0
"""Range of delays, in refreshes, beyond which its middle is no better than any guess."""
_BUSY = "does the display drop pictures, or is the computer too busy?"

READING_REFRESHES = 0.6
"""Share of a refresh, from a presentation on, in which a frame is waited for."""
LEAST_TIMEOUT_S = 0.001
TIMEOUTS_TO_FAIL = 3
_WARM_UP_PICTURES = 20
"""Most pictures shown before any counts."""


@dataclass(frozen=True)
class DelayResult:
    """The delay and how well it is known. Times in s.

    latency_s: the delay, as `[display] latency_s` holds it; below zero where stamps come early. sigma_s: its
    standard deviation. range_s: where the codes show no more than that it lies from, to; latency_s is the
    middle then; None where it was measured. why: of a range, what kept it from being measured. scatter_s:
    of a delay that is not steady, by how much it changes from frame to frame; None of one that is.
    jitter_s: that of single frames' delays, NaN where single frames only bound it.
    refresh_hz, camera_rate_hz: by presentation and frame times. horizon_s: median time from a frame's
    mid-exposure to that of the frames that saw the picture shown after it, weighted by light; computing
    is not in it. frames: that came; read: whose codes fit what was shown; used: that gave a delay of
    their own.
    """

    latency_s: float
    sigma_s: float
    jitter_s: float
    refresh_hz: float
    camera_rate_hz: float
    horizon_s: float
    frames: int
    read: int
    used: int
    range_s: tuple[float, float] | None = None
    why: str = ""
    scatter_s: float | None = None

    @property
    def delay_frames(self) -> float:
        """The loop's whole delay in camera frames, as `control.margin` takes it."""
        return self.horizon_s * self.camera_rate_hz

    def rig_values(self, believed_s: float) -> dict[str, Any]:
        """Keys and values of a rig file.

        Parameters
        ----------
        believed_s : float
            What the rig file says; it stays where it lies within a range.

        Returns
        -------
        dict
            By dotted key, for `Rig.replace`; None takes a key out.
        """
        if self.range_s is None:
            return {"display.latency_s": round(self.latency_s, 6), "display.latency_range_s": None}
        low_s, high_s = (round(one_s, 6) for one_s in self.range_s)
        kept = low_s <= believed_s <= high_s
        latency_s = believed_s if kept else round(self.latency_s, 6)
        return {"display.latency_s": latency_s, "display.latency_range_s": [low_s, high_s]}


class UnsteadyDelayError(MeasurementError):
    """The delay changes by more from frame to frame than any one value stands for; scatter_s: by how much."""

    def __init__(self, message: str, scatter_s: float) -> None:
        super().__init__(message)
        self.scatter_s = scatter_s


def measure_delay(
    rig: Rig,
    devices: Devices,
    seconds: float = DEFAULT_SECONDS,
    on_frame: Callable[[], object] = lambda: None,
) -> DelayResult:
    """Show coded pictures of the mirror at rest for `seconds` of the run's clock and time them.

    Nothing may touch the mirror. The pictures differ only by their codes; another one is shown at every
    refresh. Only exposures that share pictures measure the delay: while too few do, and the clocks of camera
    and panel still drift past each other, it goes on, for `MOST_SECONDS` at most. To be
    used in the main thread, as windows must be. CameraLost and DisplayLost pass.

    Parameters
    ----------
    rig : Rig
        The bench.
    devices : Devices
        Its opened devices.
    seconds : float
        How long to measure, at least.
    on_frame : callable, optional
        Called for every frame.

    Returns
    -------
    DelayResult
        The delay and how well it is known.

    Raises
    ------
    MeasurementError
        No room for strips, too few frames that could be read, or delays that do not agree at all.
    """
    look = _Look(rig, devices)
    look.warm_up()
    clock = devices.clock
    start_ns = until_ns = clock.now_ns()
    while True:
        until_ns += round(1e9 * seconds)
        while clock.now_ns() < until_ns:
            if look.frame():
                on_frame()
        settled = look.settled()
        moved_on = look.phases.moved_on()
        if settled or not moved_on or clock.now_ns() - start_ns > 1e9 * MOST_SECONDS:
            return look.result()


class _Look:
    """Coded pictures shown, the frames that saw them, and what these say."""

    def __init__(self, rig: Rig, devices: Devices) -> None:
        self._rig, self._devices = rig, devices
        self._rest = Rest.of(rig, Optics(rig))
        strips = find_strips(with_strips(rig), self._rest)
        if strips is None:
            raise MeasurementError(
                "delay: the camera does not see the panel along two edges: no room for codes"
            )
        self._drawer = Drawer(rig, devices.display, devices.clock, self._rest, strips)
        reader = StripReader(strips, rig.camera.noise, rig.camera.bits)
        self._watch = DelayWatch(reader, PanelTiming.of(rig.display), rig.display.refresh_hz)
        self._log = PresentationLog(self._rest.q.shape[:2])
        self._refresh_ns = 1e9 / rig.display.refresh_hz
        self._poll = poll_of(devices.display) or (lambda: None)
        self._shown_ns: list[int] = []
        self._newest: Frame | None = None
        self._came_ns = devices.clock.now_ns()
        self._begin()

    def _begin(self) -> None:
        """Count frames from here on."""
        self._stamps: list[tuple[int, int]] = []
        self._found: list[Match] = []
        self._horizons_ns: list[float] = []
        self._legible = 0
        self.phases = ClockPhases(self._refresh_ns)

    def frame(self) -> bool:
        """Show the next picture; whether a frame came until the one after it is due."""
        clock, newest, rest = self._devices.clock, self._newest, self._rest
        self._poll()
        code = len(self._shown_ns) % CODES
        shown_ns = self._drawer.draw(rest.q, code)
        self._shown_ns.append(shown_ns)
        self._log.record(shown_ns, rest.q, newest.time_ns if newest else None, code)
        # the next picture is to be ready for the next refresh, even if the display does not wait for it
        next_ns = shown_ns + round(READING_REFRESHES * self._refresh_ns)
        frame = self._read(max(1e-9 * (next_ns - clock.now_ns()), LEAST_TIMEOUT_S))
        if frame is None:
            return False
        self._newest, self._came_ns = frame, clock.now_ns()
        self._stamps.append((frame.number, frame.time_ns))
        self.phases.note(frame.time_ns - shown_ns)
        self._match(frame)
        clock.sleep_until_ns(next_ns)
        return True

    def _match(self, frame: Frame) -> None:
        rest, watch = self._rest, self._watch
        timing = watch.timing_of(frame.image, frame, self._log)
        self._legible += watch.legible
        if watch.last is not None and watch.last.fits and timing is not None:
            self._found.append(watch.last)
            shown = pair(self._log, frame, timing, rest.q, rest.grid, self._rig.target.kind)
            if shown is not None and shown.age_ns is not None:
                self._horizons_ns.append(float(np.mean(shown.age_ns)))

    def _read(self, wait_s: float) -> Frame | None:
        """Newest frame, None when none came within `wait_s`; MeasurementError after long silence."""
        devices, silent_s = self._devices, TIMEOUTS_TO_FAIL * self._rig.control.timeout_s
        try:
            return devices.camera.read(wait_s)
        except CameraTimeout:
            if devices.clock.now_ns() - self._came_ns > 1e9 * silent_s:
                raise MeasurementError(f"delay: the camera gave no frame for {silent_s:g} s") from None
            return None

    def warm_up(self) -> None:
        """Read first frames and forget them: what is compiled on first use would hold up those that count."""
        for _ in range(_WARM_UP_PICTURES):
            self.frame()
            if self._horizons_ns:
                break
        self._watch.estimator.forget()
        self._begin()

    def settled(self) -> bool:
        """Whether more frames would not say more."""
        return len(self._precise_ns()) >= LEAST_FRAMES or not self._legible

    def _precise_ns(self) -> list[float]:
        return [one.delay_ns for one in self._found if self._watch.estimator.is_precise(one)]

    def result(self) -> DelayResult:
        """What all frames say together. Raises MeasurementError."""
        if len(self._found) < LEAST_FRAMES or not self._horizons_ns:
            raise MeasurementError(self._unread())
        precise = self._precise_ns()
        delay = _delay(self._found, precise, self._refresh_ns)
        return DelayResult(
            **delay,
            refresh_hz=_refresh_hz(self._shown_ns, self._refresh_ns),
            camera_rate_hz=_rate_hz(self._stamps),
            horizon_s=1e-9 * float(np.median(self._horizons_ns)),
            frames=len(self._stamps),
            read=len(self._found),
            used=len(precise),
        )

    def _unread(self) -> str:
        """Why too few frames are of use: what they show, or when they came."""
        frames, fitting = len(self._stamps), len(self._found)
        if self._legible < LEAST_FRAMES <= frames:
            return (
                f"delay: the codes of {self._legible} of {frames} frames could be read, "
                f"{LEAST_FRAMES} are needed: see to focus, light and rest map"
            )
        if frames < LEAST_FRAMES:
            return f"delay: {frames} frames came, {LEAST_FRAMES} are needed: is the computer too busy?"
        return f"delay: the codes of {fitting} of {frames} frames fit what was shown when: {_BUSY}"


def _delay(found: list[Match], precise: list[float], refresh_ns: float) -> dict[str, Any]:
    """Delay, its standard deviation, that of single frames; where it is only bounded, its range and why."""
    if len(precise) >= LEAST_FRAMES:
        values = np.array(precise)
        middle = float(np.median(values))
        jitter = 1.4826 * float(np.median(np.abs(values - middle)))
        if jitter > UNSTEADY_REFRESHES * refresh_ns:
            low, high = np.percentile(values, [5, 95])
            why = f"it is not steady: it scatters by {1e-6 * jitter:.1f} ms: {_BUSY}"
            return _ranged(low, high, refresh_ns, why, 1e-9 * jitter) | {"jitter_s": 1e-9 * jitter}
        sigma = 1.25 * jitter / math.sqrt(len(values))
        return {"latency_s": 1e-9 * middle, "sigma_s": 1e-9 * sigma, "jitter_s": 1e-9 * jitter}
    # Camera and panel in step, every exposure on one picture: what all frames allow. The outermost tenth of
    # the bounds is left to frames that are wrong.
    low = float(np.percentile([match.low_ns for match in found], 90))
    high = float(np.percentile([match.high_ns for match in found], 10))
    if high < low:
        why = (
            f"it is not steady: some frames say at least {1e-6 * low:.1f} ms, others at most "
            f"{1e-6 * high:.1f} ms: {_BUSY}"
        )
        return _ranged(high, low, refresh_ns, why, 1e-9 * (low - high))
    if high - low >= LOOSEST_REFRESHES * refresh_ns:
        why = "a longer exposure, or other rates of camera and panel, will show more"
        return _ranged(low, high, refresh_ns, why)
    sigma = (high - low) / math.sqrt(12)
    return {"latency_s": 0.5e-9 * (low + high), "sigma_s": 1e-9 * sigma, "jitter_s": math.nan}


def _ranged(
    low: float, high: float, refresh_ns: float, why: str, scatter_s: float | None = None
) -> dict[str, Any]:
    """A delay that lies from low to high, ns; scatter_s: where it is not steady.

    Raises MeasurementError where that says too little.
    """
    if high - low > WIDEST_REFRESHES * refresh_ns:
        message = f"delay: {why}"
        raise MeasurementError(message) if scatter_s is None else UnsteadyDelayError(message, scatter_s)
    return {
        "latency_s": 0.5e-9 * (low + high),
        "sigma_s": 1e-9 * (high - low) / math.sqrt(12),
        "jitter_s": math.nan,
        "range_s": (1e-9 * float(low), 1e-9 * float(high)),
        "why": why,
        "scatter_s": scatter_s,
    }


def _refresh_hz(shown_ns: list[int], refresh_ns: float) -> float:
    """Refresh rate by the presentation times, which are whole refreshes apart; NaN when all at once."""
    since = np.array(shown_ns, dtype=np.int64) - shown_ns[0]
    steps = np.cumsum(np.rint(np.diff(since, prepend=0) / refresh_ns))
    if steps[-1] == 0:
        return float("nan")
    return float(1e9 / np.polyfit(steps, since, 1)[0])


def _rate_hz(stamps: list[tuple[int, int]]) -> float:
    """Camera's rate by its frame numbers and times."""
    numbers, times_ns = np.array(stamps, dtype=np.int64).T
    return float(1e9 / np.polyfit(numbers - numbers[0], times_ns - times_ns[0], 1)[0])


def with_strips(rig: Rig) -> Rig:
    """Rig that asks for coded strips."""
    control = rig.control.model_copy(update={"strips": "edges"})
    return rig.model_copy(update={"control": control})
