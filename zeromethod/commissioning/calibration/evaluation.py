"""What a recorded bench comes to: geometry with sigma, depth's error, a verdict. No device is touched."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from zeromethod.calibration import (
    Blend,
    CalibrationVerdict,
    DepthError,
    Fit,
    Gain,
    KnownBall,
    KnownPress,
    MirrorEdge,
    Presses,
    RestPositions,
    RestReading,
    depth_error,
    fit,
    gains,
    judge,
    open_combinations,
)
from zeromethod.calibration.edges import EdgeSearch, find_edges
from zeromethod.calibration.level import Level
from zeromethod.commissioning.calibration.carrier import advised_carrier
from zeromethod.commissioning.calibration.first_fit import (
    first_fit,
    rest_measurements,
    with_intrinsics,
)
from zeromethod.commissioning.calibration.plan import Plan, Recorded
from zeromethod.commissioning.calibration.presses import PressWarps
from zeromethod.commissioning.calibration.projector import projector_values
from zeromethod.commissioning.calibration.prompts import Prompts, Silent
from zeromethod.commissioning.calibration.rest import decode
from zeromethod.decoding.measuring import RestMeasurement
from zeromethod.errors import MeasurementError
from zeromethod.rig.geometry import GeometrySpec
from zeromethod.rig.model import Rig
from zeromethod.surface import Peak
from zeromethod.warp.grid import NodeGrid
from zeromethod.warp.warp import Warp

PARTS = 5
DRIFT_LCD_PX = 0.3
"""Between the rest map and the loop's rest, median over the nodes, from which something moved meanwhile."""


@dataclass(frozen=True, eq=False, repr=False)
class Calibration:
    """A bench as calibrated.

    Attributes
    ----------
    recorded : Recorded
        Everything that the bench gave.
    rest : RestMeasurement
        The measured rest map.
    grid : NodeGrid
        The nodes.
    rest_warp : Warp
        The rest map at the nodes.
    fitted : Fit
        The geometry, with sigma.
    error : DepthError
        What the geometry's uncertainty makes of depth.
    open_blends : tuple of Blend
        What the data do not determine.
    gains : tuple of Gain
        What to measure next, and what it would bring.
    verdict : Verdict
        Whether to trust it, and why.
    peaks : tuple of Peak
        The known presses as read through the calibrated rig.
    drift_px : float
        Median distance of the loop's rest from the rest map, LCD px; NaN without presses.
    edges : tuple of EdgeSearch
        What became of the search for the mirror's edges.
    """

    recorded: Recorded
    rest: RestMeasurement
    grid: NodeGrid
    rest_warp: Warp
    fitted: Fit
    error: DepthError
    open_blends: tuple[Blend, ...]
    gains: tuple[Gain, ...]
    verdict: CalibrationVerdict
    peaks: tuple[Peak, ...]
    drift_px: float
    edges: tuple[EdgeSearch, ...] = ()

    def __repr__(self) -> str:
        return (
            f"<Calibration of {self.rig.name!r}: {self.verdict.level} ({self.verdict.reason}), "
            f"depth within {self.depth_percent:.2g} %>"
        )

    @property
    def rig(self) -> Rig:
        """The calibrated rig, with what is left open; "nominal" where something contradicts something."""
        known = "nominal" if self.verdict.level is Level.BAD else "calibrated"
        stated = GeometrySpec(known=known, **self.error.modes)
        return self.fitted.rig.model_copy(update={"geometry": stated}).replace(self.projector)

    @cached_property
    def projector(self) -> dict[str, Any]:
        """Keys and values of the rig file that say where a projector's picture falls; none where not seen."""
        seen = self.recorded.projection
        return {} if seen is None else projector_values(self.fitted.rig, seen)

    @property
    def depth_percent(self) -> float:
        """Depth's standard deviation by geometry, percent, rms over the regions."""
        return float(np.sqrt(np.mean(self.error.percent**2)))

    @cached_property
    def carrier(self) -> dict[str, Any] | None:
        """Best period of the carrier by what was measured, with the curve; None where nothing is seen."""
        return advised_carrier(self.fitted.rig, self.rest, self.recorded.rest, self.recorded.settling)

    @property
    def values(self) -> dict[str, Any]:
        """Keys and values of the rig file that the calibration changes."""
        return geometry_values(self.rig) | self.recorded.values | self.projector


def evaluate(
    recorded: Recorded,
    found: RestMeasurement | None = None,
    last: Mapping[str, tuple[float, float]] | None = None,
    prompts: Prompts | None = None,
) -> Calibration:
    """Fit everything that was recorded.

    found: its rest map, where it is decoded already. last: value and sigma of the parameters in the
    calibration before this one.

    Raises MeasurementError where the data contradict the rig file beyond use.
    """
    # what an earlier calibration left open has no part in this one
    rig, plan = recorded.rig.replace({**recorded.values, "geometry": None}), recorded.plan
    prompts = prompts or Silent()
    findings: list[str] = []
    with prompts.part("geometry", PARTS) as advance:
        found = found or decode(rig, recorded.rest)
        grid = NodeGrid.of_rig(rig)
        rest_warp = found.rest_map.warp(grid)
        advance()
        first = first_fit(rig, found, plan.known)
        edges = _edges(first, found, plan, prompts)
        advance()
        rig, priors = with_intrinsics(rig, plan.known)
        measurements = rest_measurements(rig, found, plan.known)
        measurements += [one.found for one in edges if isinstance(one.found, MirrorEdge)]
        reading, presses, drift = None, None, float("nan")
        if recorded.presses is not None:
            warps = recorded.presses
            reading = RestReading.of(grid, warps.rest)
            presses, ball = _pressed(warps, plan, reading)
            measurements += [presses] if presses is not None else []
            try:
                if ball is not None:
                    ball.prepared(first.rig)
                    measurements.append(ball)
            except MeasurementError as unseen:
                findings.append(f"{unseen}: it is left out")
            both = warps.rest.valid & rest_warp.valid
            apart = np.linalg.norm(warps.rest.q - rest_warp.q, axis=-1)[both]
            drift = float(np.median(apart)) if apart.size else float("nan")
        fitted = fit(priors, measurements)
        advance()
        error = depth_error(fitted, grid, reading)
        advance()
        gain = gains(fitted, error)
        usable = float(np.mean(rest_warp.valid[grid.inner]))
        verdict = judge(fitted, error, gain, usable, last, recorded.shortfalls)
        if drift > DRIFT_LCD_PX:
            findings.append(f"the picture moved by {drift:.2f} LCD px between rest map and presses")
            verdict = replace(verdict, level=Level.BAD)
        verdict = replace(verdict, findings=(*verdict.findings, *findings))
        peaks = tuple(presses.peaks(fitted.rig)) if presses is not None else ()
        advance()
    open_blends = tuple(open_combinations(fitted, error))
    return Calibration(
        *(recorded, found, grid, rest_warp, fitted, error, open_blends, tuple(gain)),
        *(verdict, peaks, drift, edges),
    )


def evaluate_or_keep(
    recorded: Recorded,
    found: RestMeasurement | None = None,
    last: Mapping[str, tuple[float, float]] | None = None,
    prompts: Prompts | None = None,
) -> Calibration:
    """Evaluate; where that fails, the rest map alone, with a verdict of bad that says why.

    Nothing that was recorded is left out of what it gives, so that it can be stored and evaluated again.
    Raises MeasurementError where not even the rest map agrees with the rig file.
    """
    try:
        return evaluate(recorded, found, last, prompts)
    except MeasurementError as error:
        try:
            return rest_alone(recorded, found, str(error), last)
        except MeasurementError:
            raise error from None


def rest_alone(
    recorded: Recorded,
    found: RestMeasurement | None,
    why: str,
    last: Mapping[str, tuple[float, float]] | None = None,
) -> Calibration:
    """Evaluate the rest map only, to keep all that was recorded; the verdict is bad for that reason `why`.

    Raises MeasurementError as `evaluate`.
    """
    plan = replace(recorded.plan, press_depths_mm=(), ball_mm=None, known=(), edges=False)
    alone = evaluate(replace(recorded, presses=None, plan=plan), found, last)
    findings = (f"{why}: geometry from the rest map alone", *alone.verdict.findings)
    return replace(
        alone, recorded=recorded, verdict=replace(alone.verdict, level=Level.BAD, findings=findings)
    )


def _edges(first: Fit, found: RestMeasurement, plan: Plan, prompts: Prompts) -> tuple[EdgeSearch, ...]:
    """Look for the edges that nobody gave."""
    given = {one.edge for one in plan.known if isinstance(one, MirrorEdge)}
    edges = tuple(one for one in find_edges(first, found) if one.edge not in given) if plan.edges else ()
    for one in edges:
        prompts.say(f"edge {one.edge}: {one.words}")
    return edges


def _pressed(warps: PressWarps, plan: Plan, reading: RestReading) -> tuple[Presses | None, KnownBall | None]:
    """Presses of known depth, and the ball, as a fit takes them."""
    known = [
        KnownPress(f"{number} of {depth:g} mm", warp, depth, plan.press_sigma_mm)
        for number, (depth, warp) in enumerate(zip(plan.press_depths_mm, warps.pressed, strict=True), start=1)
    ]
    ball = None
    if warps.ball is not None and plan.ball_mm is not None:
        ball = KnownBall(reading, warps.ball, *plan.ball_mm)
    return Presses.of(reading, known) if known else None, ball


def rest_residuals(calibration: Calibration) -> tuple[np.ndarray[Any, Any], np.ndarray[Any, Any]]:
    """Camera px (n, 2) and residual (n, 2), LCD px, of the rest map's nodes that the fit used."""
    for term in calibration.fitted.terms:
        data = term.measurement
        if isinstance(data, RestPositions):
            return data.pixel, (term.residual * data.sigma).reshape(-1, 2)
    raise AssertionError("a calibration has a rest map")


def geometry_values(rig: Rig) -> dict[str, Any]:
    """Keys and values of a rig file that hold its fitted geometry, and how well that is known."""
    camera, display, prism = rig.camera, rig.display, rig.prism
    values: dict[str, Any] = {
        "prism.pattern_angle_deg": prism.pattern_angle_deg,
        "prism.camera_angle_deg": prism.camera_angle_deg,
        "prism.index": prism.index,
        "display.centre_mm": display.centre_mm,
        "display.turn_deg": display.turn_deg,
        "display.tilt_deg": display.tilt_deg,
        "camera.position_mm": camera.position_mm,
        "camera.look_at_mm": camera.look_at_mm,
        "camera.roll_deg": camera.roll_deg,
        "camera.centre_px": camera.centre_px,
    }
    if camera.projection == "perspective":
        values |= {"camera.focal_px": camera.focal_px, "camera.distortion": camera.distortion}
    else:
        values["camera.pixel_mm"] = camera.pixel_mm
    length = "pattern_length_mm" if prism.pattern_length_mm is not None else "mirror_length_mm"
    values[f"prism.{length}"] = getattr(prism, length)
    if prism.teeth is not None:
        values |= {
            f"prism.teeth.{key}": value for key, value in prism.teeth.given().items() if key != "count"
        }
    if rig.pattern_layers and rig.pattern_layers[-1].index == 1.0:
        last = len(rig.pattern_layers) - 1
        values[f"pattern_layers[{last}].thickness_mm"] = rig.pattern_layers[-1].thickness_mm
    values |= {f"geometry.{key}": value for key, value in rig.geometry.given().items()}
    return {key: _rounded(value) for key, value in values.items()}


def _rounded(value: Any) -> Any:
    """To ten digits: far below any sigma, and legible."""
    if isinstance(value, tuple):
        return [_rounded(one) for one in value]
    return value if isinstance(value, str) else float(f"{value:.10g}")
