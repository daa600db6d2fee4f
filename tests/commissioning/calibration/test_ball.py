"""A ball of known radius, asked for after the presses, kept, and taken in."""

from dataclasses import replace

import numpy as np
import pytest

from zeromethod import Rig, open_devices
from zeromethod.commissioning.calibration import (
    Calibration,
    Plan,
    Recorded,
    evaluate,
    recall,
    record,
    store_calibration,
)

from .planted import Hand, quarter, truth

RADIUS_MM, SIGMA_MM, DEPTH_MM = 800.0, 4.0, 0.15
PLAN = Plan(
    light=False, delay=False, rest_frames=1, press_frames=6, patience_s=3.0, ball_mm=(RADIUS_MM, SIGMA_MM)
)


def bench() -> Rig:
    """The true bench with the latency that the rig file states."""
    rig = truth(quarter())
    return rig.model_copy(update={"display": rig.display.model_copy(update={"latency_s": 0.0})})


@pytest.fixture(scope="module")
def pressed() -> tuple[Recorded, list[str]]:
    with open_devices(bench()) as devices:
        hand = Hand(devices, (DEPTH_MM,), ((40.0, 0.0),), ball_mm=RADIUS_MM)
        recorded, _ = record(quarter(), devices, PLAN, hand)
    return recorded, hand.lines


@pytest.fixture(scope="module")
def left_out(pressed: tuple[Recorded, list[str]]) -> Calibration:
    """Without the ball: one of a fortieth of the radius would have a contact of a sixth, too few nodes."""
    return evaluate(replace(pressed[0], plan=replace(PLAN, ball_mm=(20.0, 0.1))))


def test_ball_is_asked_for_and_taken(pressed):
    recorded, lines = pressed
    assert "press 1 of 1: press the ball of 800 mm radius in now, and hold still for 0.1 s" in lines
    assert recorded.failure is None
    assert recorded.presses.pressed == ()
    assert recorded.presses.ball is not None


def test_ball_gives_depth_and_survives_the_disk(pressed, left_out, tmp_path):
    recorded, _ = pressed
    found = evaluate(recorded, left_out.rest)
    (term,) = (term for term in found.fitted.terms if term.measurement.name == "ball")
    # The radius as read fits the one that is known, within what noise and the rim leave.
    assert abs(float(term.residual[0])) < 3.0
    assert found.depth_percent < 0.7 * left_out.depth_percent
    again, _ = recall(store_calibration(found, "simulated", home=tmp_path).folder)
    assert again.plan.ball_mm == (RADIUS_MM, SIGMA_MM)
    np.testing.assert_array_equal(again.presses.ball.q, recorded.presses.ball.q)  # type: ignore[union-attr]


def test_ball_that_shows_too_little_is_left_out_and_said(left_out):
    assert any("ball: the contact shows too few nodes" in words for words in left_out.verdict.findings)
    assert "ball" not in {term.measurement.name for term in left_out.fitted.terms}
