"""The mirror's edges, found while a bench is calibrated, and what they bring."""

from dataclasses import replace

import numpy as np
import pytest

from zeromethod import RestMeasurement, Rig, open_devices
from zeromethod.calibration import MirrorEdge
from zeromethod.commissioning.calibration import Plan, Recorded, evaluate, record
from zeromethod.commissioning.calibration.prompts import Silent

from .planted import quarter, truth

PLAN = Plan(light=False, delay=False, rest_frames=1)


class Listener(Silent):
    """Keeps what is said."""

    def __init__(self) -> None:
        self.lines: list[str] = []

    def say(self, words: str) -> None:
        self.lines.append(words)


def wide() -> Rig:
    """The rig file, with a lens that sees both edges."""
    rig = quarter()
    camera = rig.camera.model_copy(update={"focal_px": (340.0, 340.0)})
    return rig.model_copy(update={"camera": camera})


@pytest.fixture(scope="module")
def seen() -> tuple[Recorded, RestMeasurement]:
    with open_devices(truth(wide())) as devices:
        return record(wide(), devices, PLAN)


def test_edges_in_view_are_found_reported_and_taken(seen):
    hand = Listener()
    found = evaluate(*seen, prompts=hand)
    edges = [term.measurement for term in found.fitted.terms if isinstance(term.measurement, MirrorEdge)]
    assert [one.edge for one in edges] == ["P0", "R0"]
    for one in edges:
        # within three sigma of where they are
        assert np.abs(one.predict(truth(wide())) / one.sigma).max() < 3.0
    assert [line.split(" (")[0].rsplit(" ", 1)[0] for line in hand.lines] == [
        "edge P0: found at column",
        "edge R0: found at column",
    ]
    without = evaluate(replace(seen[0], plan=replace(PLAN, edges=False)), seen[1])
    assert not without.edges
    assert found.depth_percent < 0.6 * without.depth_percent


def test_an_edge_by_hand_takes_the_place_of_the_one_found(seen):
    given = MirrorEdge("R0", np.array([[70.0, 32.0]]), 3.0)
    found = evaluate(replace(seen[0], plan=replace(PLAN, known=(given,))), seen[1])
    (edge,) = (term.measurement for term in found.fitted.terms if term.measurement.name == "edge R0")
    assert edge.sigma.tolist() == [3.0]
    assert [one.edge for one in found.edges] == ["P0"]
