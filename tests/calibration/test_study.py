"""One of the benchmark's benches at a coarser grid: depth of other presses, and whether sigma is true."""

from typing import Any

import numpy as np
import pytest

from benchmarks import calibration_study as study
from zeromethod.rig.model import Rig


@pytest.fixture(scope="module")
def outcomes(nominal: Rig) -> list[Any]:
    outcomes: list[Any] = study.study_bench(2, nominal, tests=3, cases=study.CASES[::-1])
    return outcomes


def test_other_presses_are_read_within_a_percent(outcomes):
    assert len(outcomes) == 3
    for outcome in outcomes:
        assert outcome.settled
        if outcome.case == study.CASES[0]:
            assert outcome.rms < 1.0
        if outcome.case == study.CASES[1]:
            assert outcome.rms < 2.0


def test_stated_sigma_covers_the_error(outcomes):
    for outcome in outcomes:
        # three presses of one calibration err together, so nearly as one draw
        assert np.sqrt(np.mean(outcome.normalised**2)) < 3.0, outcome
    stated = [np.median(o.sigmas) for o in outcomes if o.case == study.CASES[0]]
    assert max(stated) < 0.5
