"""The default scenario from end to end: the figures that a person is promised.

On a bench binned by 4, for speed. Its nodes lie 1.4 mm apart, the dent's sigma is 3.7 of them, which alone
costs 0.11 % of the peak; the bars are those of the full size all the same.
"""

from collections.abc import Callable
from types import ModuleType

import pytest

import zeromethod as zm
from zeromethod.session.result import RunResult
from zeromethod.session.summary import summarise

PROMISED = {
    "frames", "state", "lock_frames", "residual_px_rms", "usable_share", "valid_share", "depth_peak_mm",
    "loop_ms", "draw_ms", "read_ms", "truth", "versions", "gl_renderer", "seed",
}  # fmt: skip


@pytest.fixture(scope="module")
def result(load_benchmark: Callable[[str], ModuleType]) -> RunResult:
    return zm.run(load_benchmark("rigs").small_rig())


def test_the_default_run_meets_its_bars(result: RunResult) -> None:
    figures = summarise(result)
    assert set(figures) >= PROMISED
    assert set(figures["loop_ms"]) == {"median", "p99"}
    assert figures["state"] == zm.State.RESTING or figures["state"] == zm.State.STOPPED
    assert figures["valid_share"] >= 0.98
    hold, slide = figures["truth"], figures["truth_slide"]
    assert abs(hold["depth_peak_error_percent"]) < 0.3
    assert hold["depth_rms_error_um"] < 0.3
    assert abs(slide["depth_peak_error_percent"]) < 1.0
    assert slide["depth_rms_error_um"] < 2.0


def test_a_run_leaves_the_pictures_of_before_pressed_and_nulled(result: RunResult) -> None:
    assert result.before is not None
    assert result.pressed is not None
    assert result.nulled is not None
    assert result.before.time_s < result.pressed.time_s < result.nulled.time_s
    assert zm.peak(result.nulled.surface).depth_mm == pytest.approx(0.2, rel=3e-3)
