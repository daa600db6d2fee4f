"""How an exposure is cut into pieces."""

import numpy as np
import pytest

from zeromethod.simulation.camera import exposure_pieces
from zeromethod.simulation.panel import Presentation, SimulatedPanel
from zeromethod.simulation.scenario import load_scenario

MS = 1_000_000
SHOWN = [Presentation(0, 1), Presentation(503 * MS, 2)]


@pytest.fixture
def panel(make_rig) -> SimulatedPanel:
    return SimulatedPanel(make_rig().display, 60.0)


def test_a_still_mirror_is_one_piece(panel) -> None:
    (piece,) = exposure_pieces(load_scenario("default"), panel, SHOWN, 600 * MS, 608 * MS)
    assert piece.weight == 1.0
    assert piece.mirror == load_scenario("default").mirror_at(604 * MS)


def test_a_moving_mirror_is_seen_at_the_two_gauss_legendre_instants(panel) -> None:
    scenario = load_scenario("default")
    pieces = exposure_pieces(scenario, panel, SHOWN, 1500 * MS, 1508 * MS)
    x_mm = np.array([piece.mirror.dents[0].x_mm for piece in pieces])
    weights = np.array([piece.weight for piece in pieces])
    assert weights.sum() == pytest.approx(1.0)
    assert weights @ x_mm == pytest.approx(37.0 + 10 * 0.504)  # mean place, at 10 mm/s
    half_mm = 10 * 0.004
    assert weights @ (x_mm - weights @ x_mm) ** 2 == pytest.approx(half_mm**2 / 3, rel=1e-5)  # its variance


def test_a_jump_inside_the_exposure_gives_each_side_its_share(panel) -> None:
    before, after = exposure_pieces(load_scenario("step"), panel, SHOWN, 198 * MS, 206 * MS)
    assert (before.weight, after.weight) == pytest.approx((0.25, 0.75))
    assert before.mirror.dents == ()
    assert after.mirror.dents[0].depth_mm == 0.2


def test_the_panels_light_over_all_pieces_is_that_of_the_whole_exposure(panel) -> None:
    pieces = exposure_pieces(load_scenario("default"), panel, SHOWN, 496 * MS, 511 * MS)
    assert len(pieces) == 3  # moving until 500 ms, then still
    whole = dict(panel.weights(SHOWN, 496 * MS, 511 * MS))
    total = sum(piece.weight * dict(piece.pictures).get(2, 0.0) for piece in pieces)
    np.testing.assert_allclose(total, whole[2], atol=2e-5)


def test_light_off_leaves_the_pictures_without_light(panel) -> None:
    (piece,) = exposure_pieces(load_scenario("none"), panel, SHOWN, 0, 8 * MS, lit=False)
    assert not any(share.any() for _, share in piece.pictures)
