"""A bench that moves in mid-run is named, its readings count for nobody, until the zero is taken again."""

from typing import Any

import pytest
from small_rigs import SMALL_LCD, quarter, with_tables

import zeromethod as zm
from zeromethod.loop.events import Event
from zeromethod.rig.model import Faults, KnownRest, Rig

BUMP = 16
BOTH_SIDES = tuple(KnownRest(x_mm=(10.0, 75.0), y_mm=(side - 2.0, side + 2.0)) for side in (-12.0, 12.0))


def rig(press: str, known: tuple[KnownRest, ...] = (), follow: bool = False, **faults: Any) -> Rig:
    planted = Faults(moved_at_frame=BUMP, camera_turned_deg=(0.021, 0.0, 0.0), **faults)
    tables = {"surface": {"known_rest": known}, "simulation": {"faults": planted}}
    return quarter(display=SMALL_LCD, scenario=press, control={"follow_bench": follow}, **tables)


@pytest.mark.parametrize("known", [(), BOTH_SIDES])
def test_a_bump_is_named_within_ten_frames_and_stays_until_the_zero_is_taken(known):
    with zm.Session(rig("none", known)) as session:
        steps = list(session.run(frames=BUMP + 14))
        # the first steps have no frame of their own; frames are numbered from 0
        first = next(step for step in steps if step.state is zm.State.MOVED)
        assert BUMP <= first.frame_number <= BUMP + 10
        after = [step for step in steps if step.number > first.number]
        assert {step.state for step in after} == {zm.State.MOVED}
        assert "camera turned sideways, or LCD slid along its columns" in first.reason
        assert sum(Event.BENCH_MOVED in step.events for step in steps) == 1
        assert any("the bench moved" in note for note in session.result.notes)
        # no frame after the bump was ever called good
        good = [step for step in steps if step.state in {zm.State.LOCKED, zm.State.RESTING}]
        assert all(step.frame_number is not None and step.frame_number < BUMP for step in good)
        session.loop.rezero()
        again = list(session.run(frames=24))
        assert again[-1].state is zm.State.RESTING
        # camera's turn taken for the LCD's slide: right at rest but for noise of one frame, 0.2 um here
        assert abs(again[-1].peak.depth_mm) < 1.5e-3


def test_followed_the_readings_go_on():
    with zm.Session(rig("none", follow=True)) as session:
        steps = list(session.run(frames=BUMP + 20))
    assert sum(Event.BENCH_FOLLOWED in step.events for step in steps) >= 1
    assert steps[-1].state is zm.State.RESTING
    assert abs(steps[-1].peak.depth_mm) < 3 * steps[-1].peak.sigma_mm + 1e-3


def test_a_rim_that_is_not_at_rest_is_named():
    in_the_middle = (KnownRest(x_mm=(36.0, 44.0), y_mm=(-5.0, 5.0)),)
    with zm.Session(with_tables(rig("step", in_the_middle), simulation={"faults": Faults()})) as session:
        steps = list(session.run(frames=30))
    assert steps[-1].state is zm.State.MOVED
    assert "or the rim is not at rest" in steps[-1].reason
