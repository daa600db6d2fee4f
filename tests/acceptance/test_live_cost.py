"""What the live path costs: the benchmark's devices, and that it times every variant."""

from contextlib import nullcontext
from typing import Any

import numpy as np
import pytest

from benchmarks import live_cost as cost
from benchmarks import live_running as running
from benchmarks import memory_devices as bench
from benchmarks import rigs
from zeromethod.loop.state import NULLED

FRAMES = 30


@pytest.fixture(scope="module")
def prepared() -> Any:
    return bench.Prepared(rigs.changed(rigs.small_rig(), control={"strips": "edges"}))


def test_a_press_made_of_prepared_frames_is_nulled_with_and_without_strips(prepared):
    frames = int(np.flatnonzero(bench.PATH)[0]) + 24
    bare, live = running.run_together((cost.BARE, cost.LIVE), prepared, frames)
    for turns in (bare, live):
        assert not turns[24 - running.LEFT_OUT].nulled  # the first frame of a press, as yet unanswered
        assert sum(turn.nulled for turn in turns) > len(turns) // 2
        assert "strips contradict" not in str([turn.events for turn in turns])


def test_what_was_read_of_the_codes_in_prepared_strips_is_the_delay_of_a_display_of_memory(prepared):
    with running.Running(running.Variant("in turn, strips", live=False), prepared, FRAMES) as one:
        for _ in range(FRAMES):
            one.turn()
        estimator = one.loop.delay.estimator
        assert one.loop.status.state in NULLED
    assert estimator.settled
    # presented at once, and the light follows by the rig's own panel: a hundredth of a frame
    assert abs(estimator.value_ns) < 0.2e6


def test_every_variant_is_timed_and_held_against_another(prepared, monkeypatch):
    # read in this process: one for each variant takes as long to load as all of them run
    monkeypatch.setattr(running.Surfaces, "in_own_process", lambda *_: nullcontext())
    report = cost.measure(prepared.rig, rounds=1, frames=12)
    header, *rows = report.details
    assert [row[0] for row in rows] == [variant.name for variant in cost.VARIANTS]
    assert all(len(row) == len(header) for row in rows)
    for name, (turns,) in report.data["turns"].items():
        assert len(turns) == 12 - running.LEFT_OUT, name
        assert all(turn["turn_ms"] > 0 for turn in turns), name
    assert report.data["added"].keys() == cost.COMPARED.keys()


def test_differences_are_taken_frame_by_frame():
    def turns(extra_ms: float) -> list[Any]:
        # frames differ by far more than the variants do
        return [running.Timed(n, 10.0 * n + extra_ms, 0.0, 0.0, 0.0, True, []) for n in range(9)]

    more = cost.added([turns(1.5), turns(2.5)], [turns(0.0), turns(0.0)], "answer_ms")
    assert (more.low_ms, more.median_ms, more.high_ms) == (1.5, 2.0, 2.5)
    # the least of the rounds, 1.5 and 0 ms more than 10 per frame
    assert more.least_ms == 1.5
    # of the two rounds' medians, 1.5 and 2.5
    assert more.sigma_ms == pytest.approx(0.5)
