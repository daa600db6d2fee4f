"""Whether a calibration can be trusted, with the single most important reason."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from zeromethod.calibration.depth_modes import DepthError
from zeromethod.calibration.fitting import Fit
from zeromethod.calibration.level import Level
from zeromethod.calibration.measurements import RestPositions
from zeromethod.calibration.parameters import PARAMETERS
from zeromethod.calibration.presses import Presses
from zeromethod.calibration.prior_pull import PULL_SIGMA, pull_together, pulls
from zeromethod.calibration.shortfall import Shortfall
from zeromethod.calibration.uncertainty import Gain, strongest
from zeromethod.optics import Optics, critical_angle_rad

OUTLIERS, MISFIT, OFF_SIGMA, USABLE = 0.2, 3.0, 4.0, 0.5
DEPTH_PERCENT = 2.0
TIR_MARGIN_DEG = 0.5
_SAMPLES = 33
_TOUCHED = "something touched the mirror while the fringes were shown (calibrate again then)"


@dataclass(frozen=True)
class CalibrationVerdict:
    """How far a calibration can be trusted, and why.

    findings: every one, the most important first; empty where all is well.
    """

    level: Level
    findings: tuple[str, ...]

    @property
    def reason(self) -> str:
        """Most important finding."""
        return self.findings[0] if self.findings else "everything fits, and depth is known well"


def judge(
    fitted: Fit,
    error: DepthError,
    gain: Sequence[Gain] = (),
    usable_share: float = 1.0,
    last: Mapping[str, tuple[float, float]] | None = None,
    shortfalls: Sequence[Shortfall] = (),
) -> CalibrationVerdict:
    """Weigh a calibration.

    usable_share: of the camera's nodes, those with a place in the rest map. last: value and sigma of the
    parameters in the calibration before this one. shortfalls: what was not measured; none is ever *good*.
    """
    off = pulls(fitted)
    bad = [*_misfits(fitted), *(one.words for one in off if one.sigmas > OFF_SIGMA)]
    bad += _changes(fitted, last or {})
    if usable_share < USABLE:
        bad.append(f"only {100 * usable_share:.0f} % of the view can be used")
    weak = [one.words for one in off if PULL_SIGMA < one.sigmas <= OFF_SIGMA]
    if not off and (together := pull_together(fitted)) > PULL_SIGMA:
        weak.append(
            f"what was measured by hand disagrees with the pictures by {together:.1f} sigma, all of it taken "
            "together: measure angles, lengths and the camera's place again, or raise [priors]"
        )
    margin = tir_margin_deg(fitted)
    if margin < TIR_MARGIN_DEG:
        what = "below total reflection by" if margin < 0.0 else "above the critical angle by only"
        weak.append(f"part of the mirror is {what} {abs(margin):.1f} deg: a slope there takes the light away")
    worst = int(np.argmax(error.percent))
    if error.percent[worst] > DEPTH_PERCENT:
        text = f"depth is known to {error.percent[worst]:.1f} % only ({error.names[worst]})"
        best = strongest(gain)
        weak.insert(0, f"{text}; measure next: {best.what}" if best else text)
    bad += [one.words for one in shortfalls if one.fatal]
    weak += [one.words for one in shortfalls if not one.fatal]
    level = Level.BAD if bad else Level.UNCERTAIN if weak else Level.GOOD
    return CalibrationVerdict(level, (*bad, *weak))


def tir_margin_deg(fitted: Fit) -> float:
    """Least angle of incidence on the mirror at rest in the view, less the critical angle, degrees."""
    rig = fitted.rig
    u, v = np.meshgrid(
        np.linspace(0, rig.camera.columns - 1, _SAMPLES), np.linspace(0, rig.camera.rows - 1, _SAMPLES)
    )
    optics = Optics(rig)
    trace = optics.trace(u, v, optics.rest)
    seen = trace.reaches_display
    if not seen.any():
        return float("nan")
    incidence = np.degrees(np.arccos(np.abs(trace.cos_incidence[seen])))
    return float(incidence.min() - np.degrees(critical_angle_rad(rig.prism.index)))


def _misfits(fitted: Fit) -> list[str]:
    found = [] if fitted.settled else ["the fit did not settle: the rig file is far from this bench"]
    off: list[tuple[float, str]] = []
    for term in fitted.terms:
        data = term.measurement
        if isinstance(data, RestPositions):
            share = term.outliers / len(term.weight)
            if share > OUTLIERS:
                found.append(
                    f"{100 * share:.0f} % of the rest map fits no mirror: {_TOUCHED}, orders are wrong, or "
                    "there is a second reflection"
                )
            if fitted.inflation > MISFIT:
                text = f"the rest map is missed by {fitted.inflation:.0f} times its noise, in patches"
                found.append(
                    f"{text}: {_TOUCHED}, or the mirror is not as flat, or the lens not as simple, as the "
                    "rig file says"
                )
            continue
        worst = int(np.argmax(np.abs(term.residual)))
        size = float(np.abs(term.residual[worst]))
        name = f"press {data.presses[worst].name}" if isinstance(data, Presses) else data.name
        if size > OFF_SIGMA:
            hint = " (depths mistyped: --evaluate-again takes --press-depths)" * isinstance(data, Presses)
            off.append((size, f"{name} contradicts everything else by {size:.1f} sigma{hint}"))
    return found + [text for _, text in sorted(off, reverse=True)]


def _changes(fitted: Fit, last: Mapping[str, tuple[float, float]]) -> list[str]:
    sigma, changes = fitted.sigma, []
    for name, value in fitted.values.items():
        if name in last:
            before, spread = last[name]
            size = abs(value - before) / float(np.hypot(sigma[name], spread))
            changes.append(
                (size, f"{PARAMETERS[name].words} changed by {size:.1f} sigma since the last calibration")
            )
    return [text for size, text in sorted(changes, reverse=True) if size > OFF_SIGMA]
