"""What was learned of depth's constant: weights of slopes and ring, and whether what is read still fits."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import solve_triangular

from zeromethod.arrays import Float, Mask
from zeromethod.mechanics.whitening import Whitening
from zeromethod.surface.block_readings import BlockReadings
from zeromethod.surface.outside import Outside

_UNSURE = 10.0
"""Nats by which evidences of bodies are unsure: loads are learned one by one, and may be others as well."""
_SIGMAS = 3.0
"""Standard deviations of chi2 from which it is worth learning again."""
_SURE = 5.0
"""Standard deviations from which something presses outside the view."""
_SERVES = 200.0
"""Chi2 over the data's number up to which weights learned from one press serve another. It is 25 where a dent
has moved 6 mm or another presses beside it; 500, too much, where one twice as wide does."""


@dataclass(frozen=True, slots=True)
class Linear:
    """Weights of a constant, mm: of_ratio (n,) . (D / h) - of_slope (n, 2) . y."""

    of_ratio: Float
    of_slope: Float

    def __call__(self, read: BlockReadings) -> float:
        """The constant of a reading."""
        return float(self.of_ratio @ read.ratio) - float((self.of_slope * read.slope).sum())


@dataclass(frozen=True, slots=True)
class Fit:
    """How well slopes agree with what was learned. ring: (blocks,); gradient: (blocks, 2) of h, 1/mm.

    root: lower root of the white data's covariance.
    """

    ring: Float
    gradient: Float
    white: Whitening
    root: Float

    def chi2(self, read: BlockReadings, used: Mask) -> float:
        """Chi2 over the number of data; about 1 where they agree, less where more could press than does."""
        z = (read.slope - float(self.ring @ read.ratio) * self.gradient)[used].T.ravel()
        over = solve_triangular(self.root, self.white(z), lower=True, check_finite=False)
        return float(over @ over) / len(over)


@dataclass(frozen=True, slots=True)
class OfBody:
    """The constant as one body has it, its variance, mm^2, and that body's evidence, nats.

    variances: (loads,) of all loads; weak_shares: of loads too weak to be found one by one, and by_others, as
    `Posterior` has them. error2: of the dents' slopes over the slope, squared. outside: what presses outside
    the view. others: as bodies have it that are one standard deviation away.
    """

    constant: Linear
    variance: float
    evidence: float
    variances: Float
    weak_shares: Float
    error2: float
    by_others: float
    fit: Fit
    outside: Outside | None = None
    others: tuple[Linear, ...] = ()


@dataclass(frozen=True, slots=True)
class Learned:
    """The constant as all bodies have it that the rubber may be, with the blocks `used`.

    chi2: of what it was learned from; from_ns: time of that picture.
    """

    bodies: tuple[OfBody, ...]
    used: Mask
    chi2: float
    from_ns: int = 0

    @property
    def outside(self) -> Outside | None:
        """What presses outside the view, where there is something."""
        found = self.likeliest.outside
        return found if found is not None and found.q_mm2 > _SURE * found.sigma_q_mm2 else None

    @property
    def likeliest(self) -> OfBody:
        """By evidence."""
        return max(self.bodies, key=lambda body: body.evidence)

    def chi2_of(self, read: BlockReadings) -> float:
        """Chi2 of a reading, over the number of data."""
        return self.likeliest.fit.chi2(read, self.used)

    def changed(self, chi2: float) -> bool:
        """Whether it is worth learning again, by a reading's chi2."""
        return abs(chi2 - self.chi2) > self._relative_noise * self.chi2

    @property
    def _relative_noise(self) -> float:
        """Three standard deviations of chi2 by noise, relative: two slopes a block."""
        return _SIGMAS / float(np.sqrt(np.count_nonzero(self.used)))

    @property
    def _usual(self) -> float:
        """Chi2 to be expected of another reading: its own is less where loads were found in noise."""
        return max(self.chi2, 1.0)

    @property
    def _alike(self) -> float:
        """Chi2 up to which nothing but noise differs from what was learned."""
        return (1.0 + self._relative_noise) * self._usual

    def serves(self, chi2: float) -> bool:
        """Whether the weights serve a reading of this chi2."""
        return chi2 <= (_SERVES if self.likeliest.variances.any() else self._alike)

    def of(self, read: BlockReadings, chi2: float) -> tuple[float, float]:
        """(constant, its standard deviation) of a reading that this serves, mm; chi2: that reading's."""
        share = np.array([body.evidence for body in self.bodies])
        share = np.exp((share - share.max()) / _UNSURE)
        share /= share.sum()
        values = np.array([body.constant(read) for body in self.bodies])
        # by what presses that was not there when it was learned
        more = 2.0 * np.count_nonzero(self.used) * (chi2 - self._usual) if chi2 > self._alike else 0.0
        variances = [
            self._usual * body.variance
            + more * body.by_others
            + sum((other(read) - value) ** 2 for other in body.others)
            for body, value in zip(self.bodies, values, strict=True)
        ]
        mean = float(share @ values)
        return mean, float(np.sqrt(share @ (np.array(variances) + (values - mean) ** 2)))
