"""Measuring the delay between display and camera: coded pictures of the mirror at rest, one after the other.

What "the delay" is, is said once, in `zeromethod.exposure.delay`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from zeromethod.arrays import Float
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
from zeromethod.rig.save import save_values
from zeromethod.warp.rest import Rest

DEFAULT_SECONDS = 3.0

LEAST_FRAMES = 8
"""Frames with a delay of their own that a result needs."""

LOOSEST_REFRESHES = 0.3
"""Widest range of delays, in refreshes, whose middle is taken: noise is part of it, so that the middle is a
tenth of a refresh off at most."""

UNSTEADY_REFRESHES = 0.25
"""Scatter of single frames' delays, in refreshes, beyond which none of them is the bench's."""
_BUSY = "does the display drop pictures, or is the computer too busy?"

READING_REFRESHES = 0.6
"""Share of a refresh, from a presentation on, in which a frame is waited for."""
LEAST_TIMEOUT_S = 0.001
TIMEOUTS_TO_FAIL = 3


@dataclass(frozen=True)
class DelayResult:
    """The delay and how well it is known. Times in s.

    latency_s: the delay, as `[display] latency_s` holds it; below zero where stamps come early. sigma_s: its
    standard deviation. jitter_s: that of single frames' delays, NaN where single frames only bound it.
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

    @property
    def delay_frames(self) -> float:
        """The loop's whole delay in camera frames, as `control.margin` takes it."""
        return self.horizon_s * self.camera_rate_hz


def measure_delay(
    rig: Rig,
    devices: Devices,
    seconds: float = DEFAULT_SECONDS,
    on_frame: Callable[[], object] = lambda: None,
) -> DelayResult:
    """Show coded pictures of the mirror at rest for `seconds` of the run's clock and time them.

    Nothing may touch the mirror. The pictures differ only by their codes; another one is shown at every
    refresh, so that exposures that lie anywhere share pictures. To be
    used in the main thread, as windows must be. CameraLost and DisplayLost pass.

    Parameters
    ----------
    rig : Rig
        The bench.
    devices : Devices
        Its opened devices.
    seconds : float
        How long to measure.
    on_frame : callable, optional
        Called for every frame.

    Returns
    -------
    DelayResult
        The delay and how well it is known.

    Raises
    ------
    MeasurementError
        No room for strips, too few frames that could be read, or delays that do not agree.
    """
    rest = Rest.of(rig, Optics(rig))
    strips = find_strips(with_strips(rig), rest)
    if strips is None:
        raise MeasurementError("delay: the camera does not see the panel along two edges: no room for codes")
    drawer = Drawer(rig, devices.display, rest, strips)
    timing = PanelTiming.of(rig.display)
    reader = StripReader(strips, rest.grid.image_shape, rig.camera.noise, rig.camera.bits)
    watch = DelayWatch(reader, timing, rig.display.refresh_hz)
    log = PresentationLog(rest.q.shape[:2])
    shown_ns: list[int] = []
    stamps: list[tuple[int, int]] = []
    found: list[Match] = []
    horizons_ns: list[float] = []
    newest: Frame | None = None
    clock, refresh_ns = devices.clock, 1e9 / rig.display.refresh_hz
    poll = poll_of(devices.display) or (lambda: None)
    start_ns = came_ns = clock.now_ns()
    while clock.now_ns() - start_ns < 1e9 * seconds:
        poll()
        code = len(shown_ns) % CODES
        shown_ns.append(drawer.draw(rest.q, code))
        log.record(shown_ns[-1], rest.q, newest.time_ns if newest else None, code)
        # the next picture is to be ready for the next refresh, even if the display does not wait for it
        next_ns = shown_ns[-1] + round(READING_REFRESHES * refresh_ns)
        try:
            newest = devices.camera.read(max(1e-9 * (next_ns - clock.now_ns()), LEAST_TIMEOUT_S))
        except CameraTimeout:
            if clock.now_ns() - came_ns > 1e9 * TIMEOUTS_TO_FAIL * rig.control.timeout_s:
                waited_s = TIMEOUTS_TO_FAIL * rig.control.timeout_s
                raise MeasurementError(f"delay: the camera gave no frame for {waited_s:g} s") from None
            continue
        came_ns = clock.now_ns()
        on_frame()
        stamps.append((newest.number, newest.time_ns))
        frame_timing = watch.timing_of(newest.image, newest, log)
        if watch.last is not None and watch.last.fits and frame_timing is not None:
            found.append(watch.last)
            shown = pair(log, newest, frame_timing, rest.q, rest.grid, rig.target.kind)
            horizons_ns += _mean_age_ns(shown.age_ns if shown else None)
        clock.sleep_until_ns(next_ns)
    if newest is None or len(found) < LEAST_FRAMES or not horizons_ns:
        raise MeasurementError(
            f"delay: the codes of {len(found)} of {len(stamps)} frames could be read, "
            f"{LEAST_FRAMES} are needed: see to focus, light and rest map"
        )
    precise = [one.delay_ns for one in found if watch.estimator.is_precise(one)]
    latency_ns, sigma_ns, jitter_ns = _delay(found, precise, refresh_ns)
    return DelayResult(
        latency_s=1e-9 * latency_ns,
        sigma_s=1e-9 * sigma_ns,
        jitter_s=1e-9 * jitter_ns,
        refresh_hz=_refresh_hz(shown_ns, refresh_ns),
        camera_rate_hz=_rate_hz(stamps),
        horizon_s=1e-9 * float(np.median(horizons_ns)),
        frames=len(stamps),
        read=len(found),
        used=len(precise),
    )


def _mean_age_ns(age_ns: Float | None) -> list[float]:
    """Mean age of what a frame saw; empty where it is not known."""
    return [] if age_ns is None else [float(np.mean(age_ns))]


def _delay(found: list[Match], precise: list[float], refresh_ns: float) -> tuple[float, float, float]:
    """Delay, its standard deviation, that of single frames, ns."""
    if len(precise) >= LEAST_FRAMES:
        values = np.array(precise)
        middle = float(np.median(values))
        jitter = 1.4826 * float(np.median(np.abs(values - middle)))
        if jitter > UNSTEADY_REFRESHES * refresh_ns:
            raise MeasurementError(f"delay: it is not steady: it scatters by {1e-6 * jitter:.1f} ms: {_BUSY}")
        return middle, 1.25 * jitter / math.sqrt(len(values)), jitter
    # Camera and panel in step, every exposure on one picture: what all frames allow. The outermost tenth of
    # the bounds is left to frames that are wrong.
    low = float(np.percentile([match.low_ns for match in found], 90))
    high = float(np.percentile([match.high_ns for match in found], 10))
    if high < low:
        raise MeasurementError(
            f"delay: it is not steady: some frames say at least {1e-6 * low:.1f} ms, others at most "
            f"{1e-6 * high:.1f} ms: {_BUSY}"
        )
    if high - low >= LOOSEST_REFRESHES * refresh_ns:
        raise MeasurementError(
            f"delay: the codes only show that it lies from {1e-6 * low:.1f} to {1e-6 * high:.1f} ms: "
            "a longer exposure, or other rates of camera and panel, will show more"
        )
    return 0.5 * (low + high), (high - low) / math.sqrt(12), float("nan")


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


def with_strips(rig: Rig, on: bool = True) -> Rig:
    """Rig that asks for coded strips, or for none."""
    control = rig.control.model_copy(update={"strips": "edges" if on else "none"})
    return rig.model_copy(update={"control": control})


def store_timing(path: Path, latency_s: float, others: Mapping[str, float | str] | None = None) -> None:
    """Store a measured delay in a rig file, and other values by key; all else stays. Raises InputError."""
    save_values(path, {"display.latency_s": round(latency_s, 6), **(others or {})})
