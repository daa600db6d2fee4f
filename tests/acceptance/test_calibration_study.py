"""One unknown bench by exact rays: what each set of data leaves of depth, and whether its sigma is true."""

import numpy as np
import pytest

from benchmarks import calibration_study as study
from zeromethod import binned, load_rig

pytestmark = pytest.mark.long


@pytest.fixture(scope="module")
def outcomes():
    # nodes as far apart as by half the pixels of the packaged camera
    nominal = study.changed(binned(load_rig("simulated"), 4), target={"period_px": 8})
    return {one.case: one for one in study.study_bench(0, nominal, tests=8)}


def test_depth_is_within_the_bars(outcomes):
    assert outcomes["edges and three presses"].rms < 1.0
    assert outcomes["one press"].rms < 2.0


def test_every_sigma_is_honest(outcomes):
    for outcome in outcomes.values():
        assert outcome.settled
        # the presses of one bench share its geometry's error: 3 sigma by chance in 3 of 1000 benches
        assert np.abs(outcome.normalised).max() < 3.0, outcome


def test_a_ball_whose_rim_folds_does_not_claim_a_small_sigma(outcomes):
    true_rig = outcomes["(the true rig)"]
    balls = np.array(true_rig.kinds) == 3
    assert balls.sum() == 2
    # read through the true rig: what is left is the fold's
    assert np.abs(np.array(true_rig.errors)[balls]).max() < 1.0
    assert min(np.array(true_rig.sigmas)[balls]) > 5 * max(np.array(true_rig.sigmas)[~balls])


def test_known_depths_narrow_sigma(outcomes):
    three, one, none = (
        np.median(outcomes[case].geometry_sigmas)
        for case in ("edges and three presses", "one press", "rest map alone")
    )
    assert three < one < 0.3 * none
