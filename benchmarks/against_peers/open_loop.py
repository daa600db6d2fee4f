"""Why close the loop: one-shot reading against the null, with and without a 2 % error left uncorrected.

Both read the same press on the same simulated bench with the same camera, sensor and reader. Open loop: the
pattern of the mirror at rest stays on the LCD; one frame's residual is unwrapped, composed with that pattern
and read to depth. Null: the loop is closed and locked, and what is read is the warp applied, not the image.

The bench is built from a true rig, loop and reader from the rig that is believed; they differ by the error:

    sensor      the residual is read 2 % too large
    display     the panel's light is up to 2 % of full scale above what the rig says (L + 0.08 L (1 - L))
    distortion  the camera's lens moves the corners of the image outwards by 2 % of their radius

Either way of reading is zeroed at rest in the way that its user would have: open loop by frames of the
resting mirror, the null by its applied warp at rest. The measured rest also names each node's ray
(`zeromethod.warp.rest_pixels`), and this is the zero of all figures. For the distortion the two cruder
ones are given besides: none at all ("rig"), and the difference of the warps ("difference").

What it shows, on the packaged rig at full size (`binning=1`; with half as many pixels on a side the same, but
the window loses four times as much and the noise is three times as large):

- Gain: open loop reads 2 % more at every depth, the null does not. What is left, 0.1 % at 10 um and 0.01 %
  from 50 um on, is the controller's filter still forgetting its first, too large step; after 48 frames it is
  0.01 % at 10 um too.
- Display response: neither cares. Displacement is read from phases at the carrier alone, and the harmonics of
  a bent response fall on zeros of the sensor's window. This is the sensor's merit, not the loop's.
- Distortion: neither cares with the rays of the measured rest. With the difference of the warps both read the
  peak 0.2 % wrong here (the lever is right, the place is not), and with the rig's own rest both read a mirror
  that is bent by 24 um rms. Composing with what was shown makes open loop as absolute as the null: zeroing
  helps here, closing the loop does not.
- With everything right open loop loses 0.3 % of the peak to the window's average, which no longer is a
  constant at 0.2 mm, and past 0.2 mm it loses the middle of the dent (8 to 12 % of the peak) where the
  displaced carrier leaves the window's band. The null ends where total reflection does, at 0.3 to 0.4 mm, and
  says so: it is not locked.
- Open loop is as good for presses of up to about 2 um (2 % of them is below its noise of 7 nm), and it is
  faster: one frame instead of eight. The null's lower noise, 3 nm, is that of its filter over frames; open
  loop would have it as well from as many frames.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from benchmarks.pads import pad
from benchmarks.rigs import coarser
from zeromethod.arrays import Float
from zeromethod.clock import SimulatedClock
from zeromethod.devices.protocols import TrueMirror
from zeromethod.errors import MeasurementError
from zeromethod.loop.loop import Loop
from zeromethod.loop.state import NULLED
from zeromethod.loop.step import Step
from zeromethod.optics import Optics
from zeromethod.pattern import Response, Target
from zeromethod.rig.load import load_rig
from zeromethod.rig.model import Rig
from zeromethod.sensing.residual import Residual
from zeromethod.sensing.sensor import ResidualSensor, Sensor
from zeromethod.simulation.camera import SimulatedCamera
from zeromethod.simulation.display import SimulatedDisplay
from zeromethod.simulation.path import PathPoint, PressPath
from zeromethod.simulation.press import Mirror
from zeromethod.simulation.scenario import Scenario
from zeromethod.surface import SurfaceReader
from zeromethod.surface.comparison import AT_REST, Comparison, compare
from zeromethod.warp.grid import NodeGrid
from zeromethod.warp.rest_pixels import RestGrid
from zeromethod.warp.warp import Warp

Method = Literal["open", "null"]
Zero = Literal["rays", "difference", "rig"]

ERROR = 0.02
"""The planted errors."""

ERRORS = ("none", "sensor", "display", "distortion")
METHODS: tuple[Method, ...] = ("open", "null")
ZEROS: tuple[Zero, ...] = ("rays", "difference", "rig")

DEPTHS_MM = (0.0005, 0.002, 0.01, 0.05, 0.1, 0.2, 0.3, 0.4)
QUICK_DEPTHS_MM = (0.01, 0.2)
PRESS_MM = (37.0, 4.0)
"""Where the pad comes down: off the middle of the view (x = 42), where a distortion matters."""
SIGMA_MM = 5.0

BINNING, QUICK_BINNING = 2, 4

FRAMES = 4
"""Frames read per depth, the last of those that the press is held for; each is a reading of its own."""
_HELD_FRAMES: dict[Method, int] = {"open": FRAMES + 16, "null": FRAMES + 20}
"""After a jump one exposure sees two mirrors; what presses is learned 12 frames later. The null is locked
after 8 frames, at the end of total reflection after a few more."""
_ZERO_FRAMES = 24
"""Frames that the mirror rests for before all else; all that can be read make the zero."""


def steps(quick: bool = False) -> int:
    """How often `compare_open_loop` calls `on_step`."""
    return len(ERRORS) * len(METHODS) * len(_levels(quick))


def compare_open_loop(
    on_step: Callable[[str], None] | None = None, *, quick: bool = False, binning: int | None = None
) -> dict[str, Any]:
    """Figures of both ways of reading, JSON-ready.

    on_step: called `steps(quick)` times, after each level of each staircase of presses, with what comes
    next. quick: fewer depths on fewer pixels. binning: of the packaged `simulated` rig; 1 is the full size.

    Returns {"rig", "binning", "press", "frames", "error", "noise_floor_nm": {method: nm},
    "errors": {kind: {method: [row]}}, "distortion_zeros": {zero: {method: [row]}}}. A row: depth_mm,
    peak_error_percent (mean over the frames), peak_scatter_percent (of a single frame), rms_error_nm (single
    frame, over nodes), residual_rms_px (of the frames read), valid_share, frames (0 where it could not be
    read: never locked, or nothing valid; then the others are None).
    """
    binning = binning or (QUICK_BINNING if quick else BINNING)
    believed = coarser(load_rig("simulated"), binning)
    advance = _Steps(
        on_step, [f"{kind}, {method}" for kind in ERRORS for method in METHODS for _ in _levels(quick)]
    )
    errors: dict[str, dict[str, list[dict[str, Any]]]] = {}
    zeros: dict[str, dict[str, list[dict[str, Any]]]] = {zero: {} for zero in ZEROS}
    floor_nm = {}
    for kind in ERRORS:
        errors[kind] = {}
        for method in METHODS:
            staircase = _Staircase(kind, method, believed, _levels(quick))
            readings = list(staircase.readings(advance))
            for zero in ZEROS if kind == "distortion" else ZEROS[:1]:
                reader = _Reader(staircase, readings[0], zero)
                rows = [_row(reader, reading) for reading in readings[1:]]
                if zero == "rays":
                    errors[kind][method] = rows[1:]
                if kind == "distortion":
                    zeros[zero][method] = rows[1:]
                if kind == "none":
                    floor_nm[method] = rows[0]["rms_error_nm"]
    return {
        "rig": believed.name,
        "binning": binning,
        "press": {"shape": "load", "sigma_mm": SIGMA_MM, "x_mm": PRESS_MM[0], "y_mm": PRESS_MM[1]},
        "frames": FRAMES,
        "seed": believed.simulation.seed,
        "error": ERROR,
        "noise_floor_nm": floor_nm,
        "errors": errors,
        "distortion_zeros": zeros,
    }


def true_rig(believed: Rig, kind: str) -> Rig:
    """The rig that the bench really is when `believed` is wrong by the error `kind`."""
    if kind == "display":
        light = Response.from_rig(believed.display).light(np.arange(256))
        bowed = light + 4 * ERROR * light * (1 - light)
        display = believed.display.model_copy(update={"response_light": tuple(bowed.tolist())})
        return believed.model_copy(update={"display": display})
    if kind == "distortion":
        camera = believed.camera
        assert camera.focal_px is not None
        far = np.maximum(
            camera.centre_px, np.subtract((camera.columns - 1, camera.rows - 1), camera.centre_px)
        )
        k1 = ERROR / float(np.sum((far / camera.focal_px) ** 2))
        distorted = camera.model_copy(update={"distortion": (k1, 0.0, 0.0, 0.0, 0.0)})
        return believed.model_copy(update={"camera": distorted})
    return believed


@dataclass
class _Steps:
    """Says what comes next after every step."""

    on_step: Callable[[str], None] | None
    names: list[str]
    done: int = 0

    def __call__(self) -> None:
        self.done += 1
        if self.on_step is not None:
            self.on_step(self.names[self.done] if self.done < len(self.names) else "")


class _MisreadingSensor:
    """A sensor whose residual comes out `gain` times too large."""

    def __init__(self, sensor: Sensor, gain: float) -> None:
        self._sensor, self._gain = sensor, gain

    def measure(self, image: NDArray[Any], *guesses: Float | None, **known: Any) -> Residual:
        residual = self._sensor.measure(image, *guesses, **known)
        return replace(residual, d=self._gain * residual.d)

    def set_reference(self, residual: Residual | None) -> None:
        self._sensor.set_reference(residual)

    def scale_reference(self, ratio: float) -> None:
        """Expect this many times the light."""
        self._sensor.scale_reference(ratio)


@dataclass(frozen=True)
class _Reading:
    """The frames read at one level: their warps, residual rms in camera px, and the true mirror."""

    depth_mm: float
    warps: list[Warp]
    residual_rms_px: float
    mirror: TrueMirror


def _levels(quick: bool) -> tuple[float, ...]:
    """Depths in mm held one after the other: rest for the zero, rest for the noise, then the presses."""
    return (0.0, 0.0, *(QUICK_DEPTHS_MM if quick else DEPTHS_MM))


class _Staircase:
    """A bench of the true rig under a press that jumps from depth to depth, and the loop that believes."""

    def __init__(self, kind: str, method: Method, believed: Rig, levels: Sequence[float]) -> None:
        self.kind, self.method, self.believed, self.levels = kind, method, believed, levels
        self.truth = Optics(true_rig(believed, kind))
        self.optics = Optics(believed)
        self.grid = NodeGrid.of_rig(believed)
        frames = np.full(len(levels), _HELD_FRAMES[method])
        frames[0] = _ZERO_FRAMES
        self._ends_ns = [round(1e9 * n / believed.camera.rate_hz) for n in np.cumsum(frames)]

    def _scenario(self) -> Scenario:
        points = []
        for (before, after), end_ns in zip(pairwise(self.levels), self._ends_ns, strict=False):
            points += [PathPoint(end_ns, *PRESS_MM, depth) for depth in (before, after)]
        path = PressPath(pad(*PRESS_MM, 0.0, SIGMA_MM), tuple(points))
        return Scenario("staircase", (path,), 1e-9 * self._ends_ns[-1])

    def readings(self, advance: Callable[[], None]) -> Iterator[_Reading]:
        """One reading per level, from the last frames in it that can be read."""
        clock = SimulatedClock()
        display = SimulatedDisplay(self.truth.rig, clock)
        camera = SimulatedCamera(self.truth.rig, clock, display)
        camera.scenario = self._scenario()
        try:
            sensor = self._misreading() if self.kind == "sensor" else None
            loop = Loop(self.believed, camera, display, clock, optics=self.optics, sensor=sensor)
            loop.freeze(self.method == "open")
            half_ns = round(0.5e9 * self.believed.camera.exposure_s)
            level, start_ns = 0, 0
            taken: list[Step] = []
            for step in loop.run():
                end_ns = self._ends_ns[level]
                if step.time_ns + half_ns > end_ns:
                    mirror = camera.truth(end_ns - 1)
                    yield self._reading(taken, self.levels[level], mirror, FRAMES if level else _ZERO_FRAMES)
                    advance()
                    level, start_ns, taken = level + 1, end_ns, []
                    if level == len(self.levels):
                        return
                # what is exposed across a jump sees two mirrors
                if step.time_ns - half_ns >= start_ns:
                    taken.append(step)
            raise MeasurementError(f"the loop ended: {loop.status.reason}")
        finally:
            camera.close()
            display.close()

    def _misreading(self) -> _MisreadingSensor:
        grid = NodeGrid.of_rig(self.believed)
        light = Target.from_spec(self.believed.target).light
        return _MisreadingSensor(ResidualSensor.from_rig(self.believed, grid, light), 1 + ERROR)

    def _reading(self, taken: list[Step], depth_mm: float, mirror: Mirror, most: int) -> _Reading:
        usable = [(warp, step.residual_rms_px) for step in taken if (warp := self._warp(step)) is not None]
        usable = usable[-most:]
        rms_px = float(np.sqrt(np.mean([rms**2 for _, rms in usable]))) if usable else float("nan")
        return _Reading(depth_mm, [warp for warp, _ in usable], rms_px, mirror)

    def _warp(self, step: Step) -> Warp | None:
        """The warp that a step gives to read; the null's is the one applied, and only while locked."""
        if self.method == "open":
            return step.measured
        return step.filtered if step.state in NULLED else None


class _Reader:
    """Reads warps to depth relative to the zero, as `zero` says."""

    def __init__(self, staircase: _Staircase, rest: _Reading, zero: Zero) -> None:
        self._shift: Float | float = 0.0
        self.staircase = staircase
        if not rest.warps:
            raise MeasurementError("the mirror at rest could not be read")
        grid, optics = staircase.grid, staircase.optics
        q_rest = np.mean([np.where(warp.valid[..., None], warp.q, np.nan) for warp in rest.warps], axis=0)
        if zero == "rays":
            grid = RestGrid.of(grid, optics, q_rest)
        elif zero == "difference":
            self._shift = optics.rest_map(*grid.mesh()) - q_rest
        self._reader = SurfaceReader(staircase.believed, optics, grid)

    def compare(self, warps: Sequence[Warp], mirror: TrueMirror) -> Iterator[Comparison]:
        """Errors of the depth read from warps of one mirror, against it by the true rays."""
        surface = None
        for warp in warps:
            surface = self._reader.read(replace(warp, q=warp.q + self._shift), surface)
            yield compare(surface, mirror, self.staircase.truth, self.staircase.grid)


def _row(reader: _Reader, reading: _Reading) -> dict[str, Any]:
    mirror = reading.mirror if reading.depth_mm else AT_REST
    compared = [one for one in reader.compare(reading.warps, mirror) if np.isfinite(one.depth_rms_error_um)]
    row: dict[str, Any] = {
        "depth_mm": reading.depth_mm,
        "frames": len(compared),
        "peak_error_percent": None,
        "peak_scatter_percent": None,
        "rms_error_nm": None,
        "residual_rms_px": None,
        "valid_share": None,
    }
    if compared:
        peaks = np.array([one.depth_peak_error_percent for one in compared])
        if reading.depth_mm:
            row["peak_error_percent"] = float(np.mean(peaks))
            row["peak_scatter_percent"] = float(np.std(peaks))
        squares = [one.depth_rms_error_um**2 for one in compared]
        row["rms_error_nm"] = 1e3 * float(np.sqrt(np.mean(squares)))
        row["residual_rms_px"] = reading.residual_rms_px
        row["valid_share"] = float(np.mean([one.valid_share for one in compared]))
    return row
