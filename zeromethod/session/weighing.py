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
from zeromethod.mechanics.yielding import relative_sigma
from zeromethod.rig.model import Rig, Rubber

MOST_GRAMS = 10_000.0
"""A ball of 20 mm radius under it dents the stiffest rubber by 0.25 mm: no bench needs more."""
RUBBER_MPA = (0.001, 100.0)
"""Young's moduli of rubber, from the softest silicone gels to hard rubber; others are a slip."""
GRAVITY_M_S2 = 9.81
"""From equator to poles, and up to 2 km high, it is this within 0.3 %."""
_GRAVITY_SIGMA = 0.0015
"""Relative standard deviation of that."""
_FRAMES = 32
"""Frames of which a mean is taken; as many at rest come first."""
_STILL = 0.003
"""Change of the force between the halves of these frames up to which it keeps still; rubber creeps."""

_DENTED = 10.0
"""Standard deviations from which a depth is a dent."""

_Frame = tuple[float, float, int, float]
"""Force, its sigma, contacts, true force."""


@dataclass(frozen=True)
class Weighed:
    """Young's modulus, for the Poisson's ratio of the rig file, and its standard deviation, MPa.

    weight_n: what rested there. sigma_share: of the modulus, relative, by each of its causes. true_force_n:
    what pressed a simulated mirror; NaN elsewhere.
    """

    youngs_modulus_mpa: float
    sigma_mpa: float
    weight_n: float
    contacts: int
    sigma_share: dict[str, float]
    true_force_n: float = math.nan

    @property
    def rig_values(self) -> dict[str, Any]:
        """Values of the rig file. What is weighed is E / (1 - nu^2): Poisson's ratio leaves nothing open."""
        return {
            "rubber.youngs_modulus_mpa": float(f"{self.youngs_modulus_mpa:.5g}"),
            "rubber.youngs_modulus_sigma_mpa": float(f"{self.sigma_mpa:.2g}"),
            "rubber.poisson_sigma": None,
        }


@dataclass(frozen=True)
class ModulusBefore:
    """The modulus in the rig file before a weighing, and its sigma with that of Poisson's ratio, MPa.

    off_sigmas: the modulus found less this one, over the sigma of the difference.
    """

    youngs_modulus_mpa: float
    sigma_mpa: float
    off_sigmas: float

    @classmethod
    def of(cls, rubber: Rubber, found: Weighed) -> ModulusBefore | None:
        """That of a rig's rubber; None where it had none."""
        if (had := rubber.youngs_modulus_mpa) is None:
            return None
        sigma = had * relative_sigma(rubber)
        return cls(had, sigma, (found.youngs_modulus_mpa - had) / math.hypot(sigma, found.sigma_mpa))


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
        The mirror was not nulled at rest, nothing was put on it, no force was read or it did not keep
        still within `patience_s` or before the run ended; or the modulus is no rubber's.
    """
    row: deque[_Frame] = deque(maxlen=_FRAMES)
    asked, since_s, missing = False, math.nan, "the loop did not null the mirror at rest"
    for step in steps:
        since_s = step.time_s if math.isnan(since_s) else since_s
        if step.time_s - since_s > patience_s:
            raise MeasurementError(f"weight: {missing} within {patience_s:g} s")
        # a press that is held reads well while its rim is still being nulled
        if step.state not in NULLED and not (asked and step.state is State.NULLING):
            row.clear()
        elif not asked:
            row.append((0.0, 0.0, 0, 0.0))
            if step.touching:
                raise MeasurementError("weight: something touches the mirror already: take it off")
            if len(row) == _FRAMES // 2:
                asked, since_s, missing = True, step.time_s, "nothing was put on the mirror"
                row.clear()
                say(f"put the weight of {grams:g} g on the mirror now, and let go of it")
        elif step.surface is not None and math.isfinite(step.total_force_n) and step.total_force_n > 0:
            missing = "the force did not keep still"
            true_n = sum(one.force_n for one in step.truth.contacts) if step.truth is not None else math.nan
            row.append((step.total_force_n, step.sigma_total_force_n, len(step.touching), true_n))
            if len(row) == _FRAMES and _still(row):
                return _weighed(row, grams, sigma_grams / grams)
        elif step.touching and not row:
            missing = "no force was read where it touches"
        elif step.peak is not None and step.peak.depth_mm > _DENTED * step.peak.sigma_mm and not row:
            missing = (
                "the mirror is dented, but nothing is seen to touch: a contact is found from 9 camera pixels "
                "across on: put it on a wider ball"
            )
    raise MeasurementError(f"weight: {missing} before the run ended")


def _still(row: Iterable[_Frame]) -> bool:
    force = np.array([one[0] for one in row])
    early, late = force[: _FRAMES // 2], force[_FRAMES // 2 :]
    # of the difference of two means, by what frame differs from frame, whatever comes slowly
    noise = 2 * float(np.median(np.abs(np.diff(force)))) / math.sqrt(_FRAMES)
    return bool(abs(late.mean() - early.mean()) < max(_STILL * force.mean(), 3 * noise))


def _weighed(row: Iterable[_Frame], grams: float, weight_share: float) -> Weighed:
    force, sigma, contacts, truth = (np.array(one) for one in zip(*row, strict=True))
    weight_n = 1e-3 * grams * GRAVITY_M_S2
    modulus = weight_n / float(force.mean())
    least, most = RUBBER_MPA
    if not least <= modulus <= most:
        raise MeasurementError(
            f"weight: {modulus:.3g} MPa are no rubber's ({least:g} to {most:g} MPa): {grams:g} g weigh "
            f"{weight_n:.4g} N, what was read are {force.mean():.3g} N in rubber of 1 MPa: is --grams right?"
        )
    share = {
        "weight": weight_share,
        "gravity": _GRAVITY_SIGMA,
        # of one frame: most of it is common to all frames
        "force": float(np.mean(sigma) / force.mean()),
    }
    return Weighed(
        modulus,
        modulus * math.hypot(*share.values()),
        weight_n,
        int(contacts.max()),
        share,
        float(truth[-1]),
    )


def check_weight(grams: float, sigma_grams: float) -> None:
    """Refuse, with InputError, a weight that says too little of the modulus."""
    if sigma_grams >= 0.5 * grams:
        raise InputError(f"--grams-sigma: {sigma_grams:g}: below half of --grams {grams:g}")
