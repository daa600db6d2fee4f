"""One small bench, recorded and evaluated once for all tests."""

import pytest

from zeromethod import RestMeasurement, limit_threads, open_devices
from zeromethod.commissioning.calibration import Calibration, Plan, Recorded, evaluate, record

from .planted import Hand, nominal, truth

DEPTHS_MM = (0.2, 0.15)
PLACES_MM = ((33.0, 0.0), (48.0, 2.0))
PLAN = Plan(
    press_depths_mm=DEPTHS_MM,
    press_sigma_mm=6e-4,
    light=False,
    rest_frames=2,
    press_frames=8,
    delay_s=0.6,
    patience_s=3.0,
)


@pytest.fixture(scope="session")
def session() -> tuple[Recorded, RestMeasurement, Hand]:
    limit_threads(1)
    given = nominal()
    with open_devices(truth(given)) as devices:
        hand = Hand(devices, DEPTHS_MM, PLACES_MM)
        return *record(given, devices, PLAN, hand), hand


@pytest.fixture(scope="session")
def recorded(session: tuple[Recorded, RestMeasurement, Hand]) -> Recorded:
    return session[0]


@pytest.fixture(scope="session")
def hand(session: tuple[Recorded, RestMeasurement, Hand]) -> Hand:
    return session[2]


@pytest.fixture(scope="session")
def calibration(session: tuple[Recorded, RestMeasurement, Hand]) -> Calibration:
    return evaluate(session[0], session[1])
