"""A rig whose camera was calibrated by itself: its lens model, and priors that leave room for it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from zeromethod.calibration import Intrinsics, Priors
from zeromethod.calibration.observations import INTRINSICS
from zeromethod.rig.model import Rig

_WIDE = 10.0
"""Priors of distortion, in the sigma that the board gives: wide enough to leave it the word."""


def with_intrinsics(rig: Rig, known: Sequence[Any]) -> tuple[Rig, Priors]:
    """Rig with the lens model of `Intrinsics` among `known`, and priors for it; else as it is.

    Terms of distortion that the board did not ask for are 0, as they were when the others were found.
    """
    for one in known:
        if isinstance(one, Intrinsics):
            given = dict(zip(one.names, map(float, one.values), strict=True))
            spread = dict(zip(one.names, np.sqrt(np.diag(one.covariance)), strict=True))
            lens = tuple(given.get(term, 0.0) for term in INTRINSICS[4:])
            camera = rig.camera.model_copy(update={"distortion": lens})
            sigma = {f"camera.{term}": _WIDE * float(spread.get(term, 0.0)) for term in INTRINSICS[4:]}
            changed = rig.model_copy(update={"camera": camera})
            return changed, Priors.of(changed, sigma)
    return rig, Priors.of(rig)
