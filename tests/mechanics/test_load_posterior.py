"""The posterior of a sum over loads against that of all variables at once, conditioned on the data."""

from typing import NamedTuple

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from zeromethod.mechanics.load_posterior import WEAK_MM, posterior

DATA, LOADS = 12, 20
NONE_WEAK = np.array([1.0, 0.0, 0.0, 0.0])


class Problem(NamedTuple):
    phi: np.ndarray
    gamma: np.ndarray
    data: np.ndarray
    of_loads: np.ndarray
    shared: np.ndarray
    open2: float


def problem(seed, pressed_mm=0.05):
    draw = np.random.default_rng(seed)
    phi = 100.0 * draw.standard_normal((DATA, LOADS))
    gamma = np.where(draw.uniform(size=LOADS) < 0.2, draw.uniform(0.5, 2.0, LOADS) * pressed_mm**2, 0.0)
    shared = 0.1 * draw.standard_normal(DATA)
    data = phi @ (np.sqrt(gamma) * draw.standard_normal(LOADS)) + draw.standard_normal(DATA)
    # noise that is shared is part of what is open
    return Problem(phi, gamma, data, draw.standard_normal(LOADS), shared, float(2.0 * shared @ shared))


def all_at_once(p, weak_mm):
    """(weights, variance, log of the data's density) by the joint covariance of loads, noise and e."""
    whole = np.zeros((LOADS + DATA + 1,) * 2)
    whole[:LOADS, :LOADS] = np.diag(p.gamma + weak_mm**2)
    whole[LOADS:-1, LOADS:-1] = np.eye(DATA)
    whole[-1, -1] = p.open2
    whole[-1, LOADS:-1] = whole[LOADS:-1, -1] = p.shared
    assert np.linalg.eigvalsh(whole).min() > -1e-12
    to_data = np.hstack([p.phi, np.eye(DATA), np.zeros((DATA, 1))])
    to_sum = np.concatenate([p.of_loads, np.zeros(DATA), [-1.0]])
    of_data = to_data @ whole @ to_data.T
    weights = np.linalg.solve(of_data, to_data @ whole @ to_sum)
    variance = to_sum @ whole @ to_sum - weights @ of_data @ weights
    return weights, variance, multivariate_normal(np.zeros(DATA), of_data).logpdf(p.data)


@pytest.mark.parametrize("seed", range(5))
def test_it_is_that_of_all_variables_at_once(seed):
    p = problem(seed)
    found = posterior(*p, NONE_WEAK)
    weights, variance, _ = all_at_once(p, 0.0)
    # linear algebra of another order
    np.testing.assert_allclose(found.weights, weights, rtol=1e-6, atol=1e-9 * np.abs(weights).max())
    assert found.variance == pytest.approx(variance, rel=1e-6)
    covariance = np.eye(DATA) + (p.phi * p.gamma) @ p.phi.T
    np.testing.assert_allclose(found.root @ found.root.T, covariance, rtol=1e-9, atol=1e-9)
    # loads that were not there, 1 mm deep: variance of the sum over what they add to chi2, by each 8th
    missed, phi = (p.of_loads - weights @ p.phi)[::8], p.phi[:, ::8]
    chi2 = np.trace(phi.T @ np.linalg.solve(covariance, phi))
    assert found.by_others == pytest.approx(missed @ missed / chi2, rel=1e-6)


@pytest.mark.parametrize("seed", range(5))
def test_weak_loads_everywhere_count_by_how_well_they_explain_the_data(seed):
    p = problem(seed)
    found = posterior(*p)
    each = [all_at_once(p, weak_mm) for weak_mm in WEAK_MM]
    # half of the odds are for none, the rest is shared out evenly
    odds = np.array([0.5, *[0.5 / (len(WEAK_MM) - 1)] * (len(WEAK_MM) - 1)])
    odds *= np.exp([density - each[0][2] for _, _, density in each])
    evidence = each[0][2] + np.log(odds.sum()) + 0.5 * DATA * np.log(2 * np.pi)
    odds /= odds.sum()
    sums = np.array([weights @ p.data for weights, _, _ in each])
    mean = odds @ sums
    # the law of total variance
    variance = odds @ ([variance for _, variance, _ in each] + (sums - mean) ** 2)
    assert found.weights @ p.data == pytest.approx(mean, rel=1e-6)
    assert found.variance == pytest.approx(variance, rel=1e-6)
    assert found.evidence == pytest.approx(evidence, rel=1e-9)


def test_without_loads_only_what_the_noise_shares_is_known():
    p = problem(0)._replace(gamma=np.zeros(LOADS))
    found = posterior(*p, NONE_WEAK)
    np.testing.assert_allclose(found.weights, -p.shared, rtol=1e-12)
    assert found.variance == pytest.approx(p.open2 - p.shared @ p.shared, rel=1e-9)


def test_the_sum_lies_within_its_variance_of_the_truth():
    """Of 400 draws of loads and noise, the squared error over variance is 1 in the mean."""
    p = problem(3)
    found, draw = posterior(*p, NONE_WEAK), np.random.default_rng(7)
    loads = np.sqrt(p.gamma) * draw.standard_normal((400, LOADS))
    noise = draw.standard_normal((400, DATA))
    left2 = p.open2 - p.shared @ p.shared
    e = noise @ p.shared + np.sqrt(left2) * draw.standard_normal(400)
    error = (loads @ p.phi.T + noise) @ found.weights - (loads @ p.of_loads - e)
    # chi2 of 400: 1 +- 0.07, at three deviations
    assert np.mean(error**2) / found.variance == pytest.approx(1.0, abs=0.21)
