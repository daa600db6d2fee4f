"""One unknown bench from its own pictures to millimetres: calibrated, run and pressed, all simulated."""

from typing import Any

import numpy as np
import pytest

from benchmarks import calibration_benches as benches

pytestmark = [pytest.mark.long, pytest.mark.timeout(900)]


@pytest.fixture(scope="module")
def result() -> Any:
    return benches.study_bench(0)


@pytest.fixture(scope="module")
def outcomes(result: Any) -> dict[str, Any]:
    return {one.case: one for one in result.outcomes}


def test_three_presses_leave_a_percent_and_one_leaves_two(outcomes):
    assert outcomes["edges and three presses"].settled
    assert outcomes["edges and three presses"].rms < 1.0
    assert outcomes["one press"].rms < 2.0


def test_sigma_is_honest_whatever_was_measured(outcomes):
    for outcome in outcomes.values():
        # the presses of one bench share its geometry's error: 3 sigma by chance in 3 of 1000 benches
        assert np.abs(outcome.normalised).max() < 3.5, outcome


def test_less_data_gives_a_larger_sigma(outcomes):
    three, one, none = (np.median(outcomes[case].geometry_sigmas) for case in outcomes)
    assert three < one < none


def test_smooth_presses_are_nulled_throughout_and_balls_now_and_then(result):
    frames, balls = np.array(result.facts["frames"]), np.arange(benches.TESTS) % 4 == 3
    assert (frames[~balls] == benches.FRAMES).all()
    # the image folds at a ball's rim, where the loop may go on hunting
    assert (frames[balls] > 0).all()


def test_response_is_found(result):
    light = np.array(result.facts["values"]["display.response_light"])
    codes = np.linspace(0.0, 1.0, len(light))
    # a grey level in 200 of the camera's
    assert np.abs(light - codes ** result.facts["gamma"]).max() < 5e-3
