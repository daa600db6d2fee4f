"""A bench a little off the packaged one, what is measured on it, and its calibration."""

from typing import Any

import numpy as np
import pytest

from benchmarks import calibration_study as study
from zeromethod import Rig, binned, load_rig
from zeromethod.calibration import Fit, Presses, Priors, RestPositions, RestReading, fit
from zeromethod.simulation.press import Mirror


@pytest.fixture(scope="session")
def nominal() -> Rig:
    return binned(load_rig("simulated"), 4)


@pytest.fixture(scope="session")
def truth(nominal: Rig) -> Any:
    rng = np.random.default_rng(3)
    return study.Truth(study.draw(nominal, rng), rng)


@pytest.fixture(scope="session")
def positions(truth: Any) -> RestPositions:
    return RestPositions.of(truth.grid, truth.warp(Mirror()))


@pytest.fixture(scope="session")
def reading(truth: Any) -> RestReading:
    return RestReading.of(truth.grid, truth.warp(Mirror()))


@pytest.fixture(scope="session")
def presses(truth: Any, reading: RestReading) -> Presses:
    return Presses.of(reading, [truth.known_press(share) for share in (0.3, 0.7)])


@pytest.fixture(scope="session")
def rest_fit(nominal: Rig, positions: RestPositions) -> Fit:
    return fit(Priors.of(nominal), [positions])


@pytest.fixture(scope="session")
def press_fit(nominal: Rig, positions: RestPositions, presses: Presses) -> Fit:
    return fit(Priors.of(nominal), [positions, presses])
