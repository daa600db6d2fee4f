from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from small_rigs import with_tables

from benchmarks.calibration_study import Truth
from zeromethod import InputError, MeasurementError, Rig, binned, load_rig
from zeromethod.calibration import (
    Direct,
    Fit,
    KnownBall,
    KnownPress,
    Presses,
    Priors,
    RestPositions,
    build,
    describe,
    fit,
)
from zeromethod.calibration.parameters import PARAMETERS
from zeromethod.simulation.press import Dent, Mirror, Shape


def normalised(fitted: Fit, truth: Any, nominal: Rig) -> np.ndarray[Any, Any]:
    """Errors of the parameters over their stated sigma; the scale is relative to the nominal rig's."""
    true = describe(truth.rig)
    true["camera.scale"] = truth.rig.camera.focal_px[0] / nominal.camera.focal_px[0]
    sigma = fitted.sigma
    return np.array([(value - true[name]) / sigma[name] for name, value in fitted.values.items()])


def test_without_data_the_priors_stand(nominal):
    fitted = fit(Priors.of(nominal), [])
    assert fitted.values == pytest.approx(Priors.of(nominal).values(fitted.z))
    assert not fitted.z.any()
    np.testing.assert_allclose(fitted.covariance, np.eye(len(fitted.z)))


def test_a_measured_parameter_is_weighed_with_its_prior(nominal):
    """Two Gaussians, by hand: prior 0.5 +- 0.17, gauge 0.7 +- 0.1."""
    fitted = fit(Priors.of(nominal), [Direct("gap_mm", 0.7, 0.1)])
    weights = np.array([0.17, 0.1]) ** -2.0
    assert fitted.values["gap_mm"] == pytest.approx(np.average([0.5, 0.7], weights=weights))
    assert fitted.sigma["gap_mm"] == pytest.approx(weights.sum() ** -0.5)
    assert fitted.sigma["prism.index"] == pytest.approx(
        Priors.of(nominal).sigma[fitted.priors.names.index("prism.index")]
    )


def test_the_rest_map_is_fitted_to_its_noise(rest_fit):
    (term,) = rest_fit.terms
    assert rest_fit.settled
    assert rest_fit.inflation == 1.0
    # 2000 numbers less some fifteen parameters
    assert term.chi2 / term.count == pytest.approx(1.0, abs=0.1)
    assert rest_fit.chi2_per_freedom == pytest.approx(1.0, abs=0.1)


def test_stated_sigmas_of_the_parameters_are_true(rest_fit, truth, nominal):
    left = normalised(rest_fit, truth, nominal)
    # uniform draws end at 1.73 sigma of their priors; what the data fix is Gaussian
    assert np.abs(left).max() < 4.0
    assert 0.4 < np.sqrt(np.mean(left**2)) < 1.5


def test_a_rest_map_leaves_the_gap_and_the_lcds_place_open(rest_fit):
    priors = rest_fit.priors
    for name in ("display.along_mm", "gap_mm", "prism.index", "prism.length_mm"):
        assert rest_fit.sigma[name] > 0.8 * priors.sigma[priors.names.index(name)]


def test_presses_fix_the_lcds_place(rest_fit, press_fit):
    assert press_fit.settled
    assert press_fit.sigma["display.along_mm"] < 0.4 * rest_fit.sigma["display.along_mm"]
    press = press_fit.terms[-1]
    # within what the height gauge allows: uniform in +-1 um, sigma 0.58 um, plus the reading's own
    assert np.abs(press.residual).max() < 2.5


def test_wrong_orders_do_not_pull(positions, rest_fit, truth, nominal):
    """3 % of the nodes off by whole periods, a tenth of them together in a corner."""
    rng = np.random.default_rng(4)
    q = positions.q.copy()
    wrong = rng.choice(len(q), len(q) * 3 // 100, replace=False)
    q[wrong] += 64.0 * rng.choice([-1.0, 1.0], (len(wrong), 2))
    q[:4] += [0.0, 16.0]
    spoilt = fit(Priors.of(nominal), [replace(positions, q=q)])
    assert spoilt.settled
    assert spoilt.inflation == 1.0
    (term,) = spoilt.terms
    used = term.measurement
    moved = np.abs((used.predict(truth.rig) - used.measured).reshape(-1, 2)).max(axis=-1) > 5.0
    assert moved.sum() > 10
    # every node that was moved is rejected, and hardly another touched (a pair's rms passes 3 once in 8000)
    assert not term.weight[moved].any()
    assert np.count_nonzero(term.weight[~moved] < 1.0) <= 2
    # a hundredth of what calipers know, in the directions that the map fixes best far less
    shift = (spoilt.z - rest_fit.z) / np.sqrt(np.diag(rest_fit.covariance))
    assert np.abs(shift).max() < 0.7
    assert np.abs(normalised(spoilt, truth, nominal)).max() < 4.0


@pytest.mark.parametrize("face", ["dome", "cylinder"])
def test_a_curved_mirrors_radius_and_centre_are_fitted_to_the_rest_map(face):
    """A mould 2 % off: the rest map says it twice as well as the file did, within its own sigma."""
    given, rng = binned(load_rig(face), 4), np.random.default_rng(6)
    off = {"rest.scale": 1.02, "rest.x_mm": 42.3, "rest.y_mm": -0.4}
    bench = Truth(build(given, off), rng)
    found = fit(Priors.of(given), [RestPositions.of(bench.grid, bench.warp(Mirror()))])
    for name in ("rest.scale", "rest.y_mm"):
        assert abs(found.values[name] - off[name]) < 3.0 * found.sigma[name]
    assert found.sigma["rest.scale"] < 0.5 * PARAMETERS["rest.scale"].sigma(given)


def test_a_mirror_that_is_not_flat_is_not_believed(positions, rest_fit, nominal):
    """A smooth ripple of 0.1 px, five times the noise: neighbours err alike, so sigma must grow by more."""
    ripple = 0.1 * np.sin(positions.pixel[:, 0] / 20.0) * np.cos(positions.pixel[:, 1] / 17.0)
    fitted = fit(Priors.of(nominal), [replace(positions, q=positions.q + ripple[:, None])])
    assert fitted.inflation > 5.0
    for name in ("camera.k1", "camera.scale", "camera.heading_deg"):
        assert fitted.sigma[name] > rest_fit.sigma[name]


def only_the_lcds_place_unknown(truth: Any, off_mm: float) -> Priors:
    """Priors of the true rig with the LCD put `off_mm` aside, and nothing else open."""
    rig = build(truth.rig, {"display.along_mm": describe(truth.rig)["display.along_mm"] + off_mm})
    fixed = dict.fromkeys(set(describe(rig)) - {"display.along_mm"}, 0.0)
    return Priors.of(rig, fixed)


def test_one_wrong_press_among_three_is_weighed_down(truth, reading, presses):
    wrong = truth.known_press(0.5)
    wrong = KnownPress("slipped", wrong.warp, wrong.depth_mm + 0.03, wrong.sigma_mm)
    three = Presses.of(reading, [*presses.presses, wrong])
    fitted = fit(only_the_lcds_place_unknown(truth, 0.3), [three])
    weight = fitted.terms[-1].weight
    assert weight[2] < 0.2
    assert weight[:2].min() > 0.5


def test_a_ball_of_known_radius_gives_what_a_press_gives(truth, reading):
    """Ball of R = 800 mm, contact radius 11 mm, that lets the light be: curvature to 1 %."""
    x, y = truth.place(0.5, 0.5)
    warp = truth.warp(Mirror((Dent(Shape.BALL, x, y, 0.15, 800.0),)))
    ball = KnownBall(reading, warp, 800.0, 1.0)
    as_read = np.exp(ball.prepared(truth.rig).predict(truth.rig)[0])
    assert as_read == pytest.approx(800.0, rel=0.01)
    fitted = fit(only_the_lcds_place_unknown(truth, 0.8), [ball])
    assert fitted.settled
    # 1 % at 4 % per mm
    assert 0.15 < fitted.sigma["display.along_mm"] < 0.45
    off = fitted.values["display.along_mm"] - describe(truth.rig)["display.along_mm"]
    assert abs(off) < 2.0 * fitted.sigma["display.along_mm"]


def test_a_ball_that_takes_the_light_is_named(truth, reading, positions):
    x, y = truth.place(0.5, 0.5)
    warp = truth.warp(Mirror((Dent(Shape.BALL, x, y, 0.05, 150.0, contact_mm=2.7),)))
    with pytest.raises(MeasurementError, match="takes the light away"):
        KnownBall(reading, warp, 150.0, 0.1).prepared(truth.rig)


def test_a_press_without_depth_is_named(truth, reading, nominal):
    empty = truth.warp(Mirror())
    lost = replace(empty, flags=np.ones_like(empty.flags))
    with pytest.raises(MeasurementError, match="press second"):
        Presses.of(reading, [KnownPress("second", lost, 0.2, 0.001)]).prepared(nominal)
    with pytest.raises(InputError, match="above 0"):
        Presses.of(reading, [KnownPress("third", empty, 0.0, 0.001)])


def test_a_rig_that_sees_nothing_is_named(positions, nominal):
    blind = with_tables(nominal, camera={"position_mm": (0.0, 0.0, 50.0)})
    with pytest.raises(MeasurementError, match="rest map"):
        fit(Priors.of(blind), [positions])
