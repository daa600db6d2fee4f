"""A bench's geometry by its rest map and what is known by hand, before any press."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from zeromethod.calibration import Fit, Intrinsics, Measurement, Priors, RestPositions, ToothSeams, fit
from zeromethod.calibration.measurements import INTRINSICS
from zeromethod.commissioning.calibration.plan import Known
from zeromethod.decoding.measuring import RestMeasurement
from zeromethod.rig.model import Rig
from zeromethod.warp.grid import NodeGrid

_WIDE = 10.0
"""Priors of distortion, in the sigma that the board gives: wide enough to leave the decision to it."""


def rest_measurements(rig: Rig, found: RestMeasurement, known: tuple[Known, ...]) -> list[Measurement]:
    """The rest map and what was measured by hand, as a fit takes them."""
    grid = NodeGrid.of_rig(rig)
    rest = found.rest_map.warp(grid)
    seams = ToothSeams.of(rig, grid, rest)
    return [RestPositions.of(grid, rest), *([] if seams is None else [seams]), *known]


def first_fit(rig: Rig, found: RestMeasurement, known: tuple[Known, ...]) -> Fit:
    """Fit without presses: good enough to close the loop, and to know where to look for edges."""
    rig, priors = with_intrinsics(rig, known)
    return fit(priors, rest_measurements(rig, found, known))


def with_intrinsics(rig: Rig, known: Sequence[Any]) -> tuple[Rig, Priors]:
    """Rig with the lens model of `Intrinsics` among `known`, and priors for it; else as it is.

    Terms of distortion that the board did not ask for are 0, as they were when the others were found.
    """
    for one in known:
        if isinstance(one, Intrinsics):
            given = dict(zip(one.names, map(float, one.values), strict=True))
            spread = dict(zip(one.names, one.spread, strict=True))
            lens = tuple(given.get(term, 0.0) for term in INTRINSICS[4:])
            camera = rig.camera.model_copy(update={"distortion": lens})
            sigma = {f"camera.{term}": _WIDE * float(spread.get(term, 0.0)) for term in INTRINSICS[4:]}
            changed = rig.model_copy(update={"camera": camera})
            return changed, Priors.of(changed, sigma)
    return rig, Priors.of(rig)
