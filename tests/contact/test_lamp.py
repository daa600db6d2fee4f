"""Where the LCD is white inside contacts: a period away from every border."""

import numpy as np
import pytest

from zeromethod import Session, load_rig
from zeromethod.contact import Contact, Lamp, Probability
from zeromethod.warp.grid import NodeGrid

GRID = NodeGrid((384, 480))
U, V = GRID.mesh()
PERIOD = GRID.period_px
TURN = np.linspace(0, 2 * np.pi, 200, endpoint=False)


def disc(u: float, v: float, radius: float) -> Contact:
    outline = np.stack([u + radius * np.cos(TURN), v + radius * np.sin(TURN)], axis=-1)
    figures = dict.fromkeys(
        ("x_mm", "y_mm", "sigma_x_mm", "sigma_y_mm", "area_mm2", "sigma_area_mm2", "major_mm", "minor_mm",
         "angle_deg", "sigma_edge_mm", "scattered"), 1.0
    )  # fmt: skip
    nothing = Probability(0, 0, np.zeros((1, 1), np.float32))
    return Contact(id=1, **figures, outline_mm=outline, outline_px=outline, probability=nothing)


def test_nodes_a_period_inside_a_border_are_lit_and_none_nearer():
    lit = Lamp(GRID).follow([disc(240.3, 190.8, 60)])
    inside = 60 - np.hypot(U - 240.3, V - 190.8)
    # the mask's points are 4 px apart
    assert lit[inside > PERIOD + 4].all()
    assert not lit[inside < PERIOD - 3].any()


def test_contacts_nearer_than_a_period_have_no_collar_between_them():
    lit = Lamp(GRID).follow([disc(180, 192, 50), disc(290, 192, 50)])
    between = (np.abs(U - 235) < 8) & (np.abs(V - 192) < 3)
    assert lit[between].all()
    apart = Lamp(GRID).follow([disc(165, 192, 50), disc(305, 192, 50)])
    assert not apart[between].any()


def test_a_border_that_wavers_by_a_pixel_changes_nothing():
    lamp = Lamp(GRID)
    first = lamp.follow([disc(240, 192, 60)])
    assert all(lamp.follow([disc(240, 192, radius)]) is first for radius in (59.0, 60.5, 60.0))


@pytest.mark.parametrize("contacts", [[], [disc(240, 192, 10)], [disc(240, 192, 230)]])
def test_nothing_is_lit_without_contacts_in_too_small_ones_or_where_most_is_covered(contacts):
    lamp = Lamp(GRID)
    assert lamp.follow([disc(240, 192, 60)]) is not None
    assert lamp.follow(contacts) is None


@pytest.fixture(scope="module")
def untouched():
    """Frames of a mirror that nothing touches while a disc of 60 px is lit, as if it had just been lifted."""
    view = {"camera.columns": 480, "camera.rows": 384, "camera.centre_px": [239.5, 191.5]}
    rig = load_rig("simulated").replace({**view, "control.lamp": False}, scenario="none")
    with Session(rig) as session:
        list(session.loop.run(frames=5))
        lit = np.hypot(U - 240, V - 192) < 60
        steps = []
        for step in session.loop.run(frames=12):
            session.loop.light(lit)
            steps.append(step)
        session.loop.light(None)
        return steps, list(session.loop.run(frames=6))


def test_the_sensors_own_rules_leave_out_nodes_that_see_the_lamp(untouched):
    step = untouched[0][-1]
    away = np.hypot(U - 240, V - 192)
    valid = step.residual.valid
    assert not valid[away < 60].any()
    rim, far = valid & (away < 60 + 2 * PERIOD), valid & (away > 60 + 2 * PERIOD)
    assert valid[far].all()
    # what is left of its light at the rim is what a node's sigma has for an edge beside it
    off = np.abs(step.residual.d[rim])
    assert off.max() < 0.07 * PERIOD / (2 * np.pi)
    assert np.sqrt(np.mean(off**2)) < 1.5 * np.sqrt(np.mean(step.residual.d[far] ** 2))


def test_all_nodes_are_measured_again_within_five_frames_of_the_lamp(untouched):
    assert untouched[1][-1].valid_share > 0.99
    back = next(
        k for k, step in enumerate(untouched[1]) if step.residual.valid[V.shape[0] // 2, U.shape[1] // 2]
    )
    assert back <= 4
