"""What was measured by hand against the rest: planted contradictions of known size."""

import numpy as np
import pytest

from zeromethod.calibration import DepthError, Direct, Fit, Priors, describe, fit, judge
from zeromethod.calibration.prior_pull import pull_together, pulls
from zeromethod.calibration.verdict import Level
from zeromethod.rig.model import Rig

ACCURATE = DepthError(
    ("here",), np.zeros(1), np.zeros(1), np.zeros((1, 1)), np.zeros((1, 1)), np.zeros((2, 1, 1))
)


def contradicted(rig: Rig, sigmas: float, *names: str, gauge: float = 0.5) -> Fit:
    """Parameters measured again, to `gauge` of the prior's sigma, so many standard deviations off."""
    by_hand, priors = describe(rig), Priors.of(rig)
    spread = dict(zip(priors.names, priors.sigma, strict=True))
    again = [
        Direct(
            name, by_hand[name] + sigmas * spread[name] * float(np.hypot(1.0, gauge)), gauge * spread[name]
        )
        for name in names
    ]
    return fit(priors, again)


@pytest.mark.parametrize("sigmas", [3.2, 3.7, 6.0])
def test_a_pull_is_the_distance_of_two_values_over_both_sigmas(nominal, sigmas):
    (found,) = pulls(contradicted(nominal, sigmas, "prism.pattern_angle_deg"))
    # exact for a straight line; the fit stops within 3 % of a posterior sigma
    assert found.sigmas == pytest.approx(sigmas, rel=0.02)
    # without the prior, the gauge alone
    assert found.found_sigma == pytest.approx(0.5 * found.given_sigma, rel=1e-3)
    assert found.found - found.given == pytest.approx(sigmas * 0.3 * np.hypot(1, 0.5), rel=0.02)


@pytest.mark.parametrize(
    ("sigmas", "level"), [(2.0, "good"), (3.2, "uncertain"), (3.7, "uncertain"), (4.5, "bad")]
)
def test_a_value_many_sigma_off_is_never_good_and_named(nominal, sigmas, level):
    verdict = judge(contradicted(nominal, sigmas, "prism.pattern_angle_deg"), ACCURATE)
    assert verdict.level == level, verdict
    if level != "good":
        assert verdict.reason.startswith("the pattern face's angle is ")
        assert "measure it again, or raise its sigma in [priors]" in verdict.reason


def test_many_values_a_little_off_are_not_good_either(nominal):
    names = ("gap_mm", "prism.index", "prism.length_mm", "prism.pattern_angle_deg", "camera.x_mm")
    fitted = contradicted(nominal, 2.5, *names)
    assert pulls(fitted) == []
    # chi-squared of 31.25 at five degrees of freedom: p = 8.4e-6, that of 4.46 sigma
    assert pull_together(fitted) == pytest.approx(4.46, abs=0.05)
    assert judge(fitted, ACCURATE).level == Level.UNCERTAIN


def test_true_sigmas_are_left_in_peace(nominal):
    """Values by hand and by gauge both drawn from what is stated: 1.4 % of such benches pull one of five."""
    rng = np.random.default_rng(8)
    by_hand, priors = describe(nominal), Priors.of(nominal)
    spread = dict(zip(priors.names, priors.sigma, strict=True))
    names = ("gap_mm", "prism.index", "prism.length_mm", "prism.pattern_angle_deg", "camera.x_mm")
    named = 0
    for _ in range(100):
        again = [
            Direct(
                name,
                by_hand[name] + spread[name] * np.hypot(1.0, 0.5) * rng.standard_normal(),
                0.5 * spread[name],
            )
            for name in names
        ]
        fitted = fit(priors, again)
        named += bool(pulls(fitted)) or pull_together(fitted) > 3.0
    # expected: 1.6; Poisson, 99.9 %
    assert named <= 7


def test_the_wider_the_stated_sigma_the_smaller_the_pull(nominal):
    """A leg 0.2 mm off is 3.7 sigma of calipers, and nothing to a ruler that says so."""
    length_mm = describe(nominal)["prism.length_mm"]
    known = Direct("prism.length_mm", length_mm + 0.2, 0.02)
    (pull,) = pulls(fit(Priors.of(nominal), [known]))
    assert pull.sigmas == pytest.approx(0.2 / np.hypot(0.05, 0.02), rel=0.02)
    honest = nominal.replace({"priors.length_mm": 1.0})
    assert pulls(fit(Priors.of(honest), [known])) == []
