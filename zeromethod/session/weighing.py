"""How stiff the rubber is, by a known weight that rests on the mirror."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from zeromethod.errors import InputError, MeasurementError
from zeromethod.loop.state import NULLED, State
from zeromethod.loop.step import Step
from zeromethod.rig.model import Rig

GRAVITY_M_S2 = 9.81
"""From equator to poles, and up to 2 km high, it is this within 0.3 %."""
_GRAVITY_SIGMA = 0.0015
_FRAMES = 32
"""Frames of which a mean is taken; as many at rest come first."""
_STILL = 0.003
"""Change of the force between the halves of these frames up to which it keeps still; rubber creeps."""


@dataclass(frozen=True)
class Weighed:
    """Young's modulus, for the Poisson's ratio of the rig file, and its standard deviation, MPa.

    weight_n: what rested there. sigma_share: of the modulus, relative, by each of its causes.
    """

    youngs_modulus_mpa: float
    sigma_mpa: float
    weight_n: float
    contacts: int
    sigma_share: dict[str, float]

    @property
    def rig_values(self) -> dict[str, Any]:
        """Values of the rig file. What is weighed is E / (1 - nu^2): Poisson's ratio leaves nothing open."""
        return {
            "rubber.youngs_modulus_mpa": float(f"{self.youngs_modulus_mpa:.5g}"),
            "rubber.youngs_modulus_sigma_mpa": float(f"{self.sigma_mpa:.2g}"),
            "rubber.poisson_sigma": None,
        }


def for_weighing(rig: Rig) -> Rig:
    """The rig as it is read while it is weighed: with rubber of 1 MPa, whatever its file says."""
    known = {"youngs_modulus_mpa": 1.0, "youngs_modulus_sigma_mpa": 0.0, "poisson_sigma": 0.0}
    return rig.replace({f"rubber.{name}": value for name, value in known.items()})


def weigh(
    steps: Iterable[Step], grams: float, sigma_grams: float, patience_s: float, say: Callable[[str], object]
) -> Weighed:
    """Wait for the mirror at rest, ask for the weight, and take its force once it keeps still.

    Parameters
    ----------
    steps : iterable of Step
        Of a session whose rig is that `for_weighing`.
    grams, sigma_grams : float
        All that rests on the mirror, and its standard deviation.
    patience_s : float
        Longest wait for each of rest and weight, by the run's clock.
    say : callable
        Takes what to do now.

    Returns
    -------
    Weighed
        The modulus that makes the force the weight.

    Raises
    ------
    MeasurementError
        The mirror was not nulled at rest, nothing was put on it, the force did not keep still, or the run
        ended.
    """
    weight_n = 1e-3 * grams * GRAVITY_M_S2
    row: deque[tuple[float, float, int]] = deque(maxlen=_FRAMES)
    asked, since_s, missing = False, math.nan, "the loop did not null the mirror at rest"
    for step in steps:
        since_s = step.time_s if math.isnan(since_s) else since_s
        if step.time_s - since_s > patience_s:
            raise MeasurementError(f"weight: {missing} within {patience_s:g} s")
        # a press that is held reads well while its rim is still being nulled
        if step.state not in NULLED and not (asked and step.state is State.NULLING):
            row.clear()
        elif not asked:
            row.append((0.0, 0.0, 0))
            if step.touching:
                raise MeasurementError("weight: something touches the mirror already: take it off")
            if len(row) == _FRAMES // 2:
                asked, since_s, missing = True, step.time_s, "nothing was put on the mirror"
                row.clear()
                say(f"put the weight of {grams:g} g on the mirror now, and let go of it")
        elif step.surface is not None and math.isfinite(step.total_force_n) and step.total_force_n > 0:
            missing = "the force did not keep still"
            row.append((step.total_force_n, step.sigma_total_force_n, len(step.touching)))
            if len(row) == _FRAMES and _still(row):
                return _weighed(row, weight_n, sigma_grams / grams)
    raise MeasurementError("weight: the run ended before its force was taken")


def _still(row: Iterable[tuple[float, float, int]]) -> bool:
    force = np.array([one[0] for one in row])
    early, late = force[: _FRAMES // 2], force[_FRAMES // 2 :]
    # of the difference of two means, by what frame differs from frame, whatever comes slowly
    noise = 2 * float(np.median(np.abs(np.diff(force)))) / math.sqrt(_FRAMES)
    return bool(abs(late.mean() - early.mean()) < max(_STILL * force.mean(), 3 * noise))


def _weighed(row: Iterable[tuple[float, float, int]], weight_n: float, weight_share: float) -> Weighed:
    force, sigma = (np.array([one[k] for one in row]) for k in (0, 1))
    modulus = weight_n / float(force.mean())
    share = {
        "weight": weight_share,
        "gravity": _GRAVITY_SIGMA,
        # of one frame: most of it is common to all frames
        "force": float(np.mean(sigma) / force.mean()),
    }
    return Weighed(
        modulus, modulus * math.hypot(*share.values()), weight_n, max(one[2] for one in row), share
    )


def check_weight(grams: float, sigma_grams: float) -> None:
    """Refuse, with InputError, a weight that says too little of the modulus."""
    if sigma_grams >= 0.5 * grams:
        raise InputError(f"--grams-sigma: {sigma_grams:g}: below half of --grams {grams:g}")
