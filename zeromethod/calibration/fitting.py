"""One least-squares fit of a bench's geometry to everything known about it, calipers included.

In units of the priors (z = (value - mean) / sigma) the sum

    |z|^2 + sum of w ((predicted - measured) / sigma)^2

is minimised by Gauss-Newton steps, damped by multiples of the unit matrix where a step does not lower it:
the valleys that a rest map leaves open are then descended along their whole length, where damping by the
diagonal of the normal matrix stalls. As these valleys are narrow and bent, steps bend with them (geodesic
acceleration: M. K. Transtrum, J. P. Sethna, arXiv:1201.5885).

w are the weights of a robust estimate: 1 for what fits, less for what does not, 0 for a node far off. What is
cheap to predict is fitted first; presses, which are read again through each candidate rig, join when the rest
map already fits.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from zeromethod.arrays import Float
from zeromethod.calibration.measurements import Measurement, RestPositions
from zeromethod.calibration.parameters import Priors
from zeromethod.calibration.tooth_seams import ToothSeams
from zeromethod.errors import MeasurementError
from zeromethod.rig.model import Rig

_STEPS = 60
_SETTLED = 1e-3
"""Expected gain in the sum at which a fit has settled: 3 % of a posterior sigma."""
_ROUNDS = 8
_ACCURATE = 0.1
"""Error of a linearised prediction, in its sigma, that is good enough."""
_LEAST_TURN = 0.05
"""Step, in prior sigmas, from which what was not predicted is the derivatives' fault and not rounding."""
_AHEAD, _MOST_BEND = 0.1, 0.75
"""Share of a step at which the bend is felt, and how much of the step a bend may be."""
_FIRST_DAMPING, _MOST_DAMPING = 1e-3, 1e7
_MANY = 20
"""Groups from which the data's own scatter defines an outlier."""
_HUBER, _REJECT = 3.0, 6.0
_MEDIAN = {1: 0.4549, 2: 0.6931}
"""Median of chi-squared per number in groups of one and two."""


@dataclass(frozen=True, eq=False)
class Term:
    """One measurement at the fitted rig.

    residual: (n,) (predicted - measured) / sigma, 0 where there is no prediction. weight: (groups,).
    jacobian: (n, parameters) of the residual by z.
    """

    measurement: Measurement
    residual: Float
    weight: Float
    jacobian: Float

    @property
    def rows(self) -> Float:
        """(n,) weights, one per number."""
        return np.repeat(self.weight, self.measurement.group)

    @property
    def chi2(self) -> float:
        """Weighted sum of squared residuals."""
        return float((self.rows * self.residual**2).sum())

    @property
    def count(self) -> int:
        """Numbers that are not rejected."""
        return int(np.count_nonzero(self.rows > 0.0))

    @property
    def outliers(self) -> int:
        """Groups whose weight was lowered."""
        return int(np.count_nonzero(self.weight < 1.0))


@dataclass(frozen=True, eq=False)
class Fit:
    """A bench as fitted.

    z: (parameters,) in units of the priors. covariance: of z. inflation: by how much the rest map's sigma was
    raised to hold what no rig explains. steps: of the last descent. settled: whether they came to an end.

    The covariance holds close to the fit. The valleys of a rest map are bent, so that a rig one sigma away
    along one lies far outside the ellipsoid that it spans: the sigma of each parameter and of depth is true,
    but all parameters together are not Gaussian.
    """

    priors: Priors
    z: Float
    covariance: Float
    terms: tuple[Term, ...]
    inflation: float
    steps: int
    settled: bool

    @property
    def rig(self) -> Rig:
        """The fitted rig."""
        return self.priors.at(self.z)

    @property
    def values(self) -> dict[str, float]:
        """Fitted value of every free parameter."""
        return self.priors.values(self.z)

    @property
    def sigma(self) -> dict[str, float]:
        """Posterior standard deviation of every free parameter."""
        spread = self.priors.sigma * np.sqrt(np.diag(self.covariance))
        return dict(zip(self.priors.names, map(float, spread), strict=True))

    @property
    def chi2_per_freedom(self) -> float:
        """(|z|^2 + weighted squares) over the count of numbers: about 1 where priors and noise are true."""
        total = float(self.z @ self.z) + sum(term.chi2 for term in self.terms)
        return total / max(sum(term.count for term in self.terms), 1)


def fit(
    priors: Priors, measurements: Sequence[Measurement], advance: Callable[[str], None] = lambda _: None
) -> Fit:
    """Fit a rig to `measurements`, which may be any, or none.

    advance: called with a word for each part of the work when it begins.

    Raises
    ------
    MeasurementError
        A press gives no depth, or the rig file is so far off that nothing can be predicted.
    """
    advance("geometry from the rest map")
    start = np.zeros(len(priors.names))
    cheap = [o for o in measurements if not o.costly]
    # The rays of nodes are known only once it is known on which teeth they fall.
    marks = [o for o in cheap if isinstance(o, ToothSeams)]
    if marks:
        start = _descend(priors, _exact(priors, marks, start), start).z
    # The nodes well inside the mirror are known only once the mirror is.
    first = _descend(priors, _exact(priors, cheap, start), start)
    models = _exact(priors, cheap, first.z)
    result = _descend(priors, models, first.z)
    inflation = 1.0
    for index, term in enumerate(result.terms):
        data = term.measurement
        if isinstance(data, RestPositions):
            inflation = data.misfit(term.residual, term.weight)
            models[index] = _Exact(priors, data.inflated(inflation))
    if inflation > 1.0:
        result = _descend(priors, models, result.z)
    costly = [o for o in measurements if o.costly]
    if costly:
        advance("geometry from presses")
        rig = priors.at(result.z)
        result = _with_costly(priors, models, [o.prepared(rig) for o in costly], result.z)
    return replace(result, inflation=inflation)


def jacobian(priors: Priors, z: Float, measurement: Measurement) -> Float:
    """Derivative (n, parameters) of (predicted - measured) / sigma by z.

    By central differences, one-sided where costly or at a parameter's bound. NaN rows where a neighbouring
    rig predicts nothing.
    """
    result = np.zeros((len(measurement.measured), len(z)))
    middle = measurement.predict(priors.at(z)) if measurement.costly else None
    for column, name in enumerate(priors.names):
        if name in measurement.blind_to:
            continue
        step = measurement.step * (np.arange(len(z)) == column)
        ahead = priors.within(z + step)
        back = priors.within(z - step) if middle is None or ahead[column] == z[column] else z
        apart = float(ahead[column] - back[column])
        low = measurement.predict(priors.at(back)) if middle is None or back is not z else middle
        result[:, column] = (measurement.predict(priors.at(ahead)) - low) / (apart * measurement.sigma)
    return result


@dataclass(frozen=True, eq=False)
class _Exact:
    """Residuals as the rig predicts them."""

    priors: Priors
    measurement: Measurement

    def residual(self, z: Float) -> Float:
        predicted = self.measurement.predict(self.priors.at(z))
        return np.asarray((predicted - self.measurement.measured) / self.measurement.sigma)

    def slope(self, z: Float) -> Float:
        return jacobian(self.priors, z, self.measurement)


@dataclass(frozen=True, eq=False)
class _Linear:
    """Residuals that go on from those at `at` in a straight line, at no cost."""

    measurement: Measurement
    at: Float
    value: Float
    derivative: Float

    def residual(self, z: Float) -> Float:
        return np.asarray(self.value + self.derivative @ (z - self.at))

    def slope(self, z: Float) -> Float:  # noqa: ARG002 (the same everywhere)
        return self.derivative


def _exact(priors: Priors, measurements: Sequence[Measurement], z: Float) -> list[_Exact]:
    rig = priors.at(z)
    return [_Exact(priors, measurement.prepared(rig)) for measurement in measurements]


def _with_costly(priors: Priors, models: Sequence[_Exact], costly: Sequence[Measurement], z: Float) -> Fit:
    """Fit with costly data taken as linear, read again where that fit ends, until nothing new appears.

    Depths as read are so nearly linear in the rig that two or three rounds do; derivatives are corrected by
    what was not predicted (Broyden's rank-one update) instead of computed again.
    """
    exact = [_Exact(priors, measurement) for measurement in costly]
    linear = [_Linear(one.measurement, z, one.residual(z), one.slope(z)) for one in exact]
    for _ in range(_ROUNDS):
        result = _descend(priors, [*models, *linear], z)
        step, worst = result.z - z, 0.0
        length2 = float(step @ step)
        for index, (one, line) in enumerate(zip(exact, linear, strict=True)):
            value = one.residual(result.z)
            missed = value - line.residual(result.z)
            worst = max(worst, float(np.nan_to_num(np.abs(missed)).max()))
            derivative = line.derivative
            if length2 > _LEAST_TURN**2:
                derivative = derivative + np.outer(missed, step) / length2
            linear[index] = _Linear(one.measurement, result.z, value, derivative)
        z = result.z
        if worst < _ACCURATE:
            return result
    return replace(_descend(priors, [*models, *linear], z), settled=False)


def _weights(residual: Float, group: int) -> Float:
    """Robust weights (groups,): Huber's, and 0 far off where many groups define what far is."""
    squares = (residual.reshape(-1, group) ** 2).mean(axis=-1)
    many = len(squares) >= _MANY
    scale2 = max(1.0, float(np.nanmedian(squares)) / _MEDIAN[group]) if many else 1.0
    with np.errstate(invalid="ignore", divide="ignore"):
        away = np.sqrt(squares / scale2)
        weight = np.minimum(1.0, _HUBER / away)
    if many:
        weight = np.where(away > _REJECT, 0.0, weight)
    return np.where(np.isfinite(away), weight, 0.0)


def _terms(models: Sequence[_Exact | _Linear], z: Float) -> tuple[Term, ...]:
    terms = []
    for model in models:
        measurement, residual, slope = model.measurement, model.residual(z), model.slope(z)
        lost = ~(np.isfinite(residual) & np.isfinite(slope).all(axis=-1))
        if lost.all():
            raise MeasurementError(f"{measurement.name}: nothing to compare with the rig file as it is")
        weight = _weights(np.where(lost, np.nan, residual), measurement.group)
        residual, slope = np.where(lost, 0.0, residual), np.where(lost[:, None], 0.0, slope)
        terms.append(Term(measurement, residual, weight, slope))
    return tuple(terms)


def _descend(priors: Priors, models: Sequence[_Exact | _Linear], z: Float) -> Fit:
    damping, steps = 0.0, 0
    while True:
        terms = _terms(models, z)
        normal, gradient = np.eye(len(z)), z.copy()
        for term in terms:
            weighted = term.rows[:, None] * term.jacobian
            normal += weighted.T @ term.jacobian
            gradient += weighted.T @ term.residual
        settled = float(gradient @ np.linalg.solve(normal, gradient)) < _SETTLED
        done = Fit(priors, z, np.asarray(np.linalg.inv(normal)), terms, 1.0, steps, settled)
        if settled or steps == _STEPS:
            return done
        cost = float(z @ z) + sum(term.chi2 for term in terms)
        trial = z
        while trial is z:
            damped = normal + damping * np.eye(len(z))
            step = np.asarray(-np.linalg.solve(damped, gradient))
            trial = _bent(priors, models, terms, z, step, damped)
            if _cost(models, trial, terms) < cost:
                damping = 0.0 if damping <= _FIRST_DAMPING else damping / 10.0
            elif damping > _MOST_DAMPING:
                return done
            else:
                trial, damping = z, max(10.0 * damping, _FIRST_DAMPING)
        z, steps = trial, steps + 1


def _bent(
    priors: Priors,
    models: Sequence[_Exact | _Linear],
    terms: Sequence[Term],
    z: Float,
    step: Float,
    damped: Float,
) -> Float:
    """Where a step leads that follows its valley's bend.

    The second derivative along the step, from one more prediction, gives the acceleration; left out where it
    is not small against the step.
    """
    pull = np.zeros_like(z)
    for model, term in zip(models, terms, strict=True):
        counts = term.rows > 0.0
        ahead = model.residual(z + _AHEAD * step)
        bend = (ahead - term.residual)[counts] / _AHEAD - term.jacobian[counts] @ step
        pull += term.jacobian[counts].T @ (term.rows[counts] * bend) * (2.0 / _AHEAD)
    bent = -0.5 * np.linalg.solve(damped, pull)
    small = np.isfinite(bent).all() and 2.0 * np.linalg.norm(bent) <= _MOST_BEND * np.linalg.norm(step)
    return priors.within(z + step + bent if small else z + step)


def _cost(models: Sequence[_Exact | _Linear], z: Float, terms: Sequence[Term]) -> float:
    """Sum at z with the weights of `terms`; infinite where what counted can no longer be predicted."""
    total = float(z @ z)
    for model, term in zip(models, terms, strict=True):
        residual, counts = model.residual(z), term.rows > 0.0
        if not np.isfinite(residual[counts]).all():
            return float("inf")
        total += float((term.rows[counts] * residual[counts] ** 2).sum())
    return total
