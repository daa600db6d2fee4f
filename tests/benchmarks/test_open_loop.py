"""What a 2 % error does to a one-shot reading, and what it does not do to the null.

On the quick bench (pixels four times larger), whose window loses 3 to 6 % of the peak in open loop.
"""

import copy
import json
from typing import Any

import pytest

from benchmarks.against_peers.open_loop import (
    ERROR,
    ERRORS,
    METHODS,
    QUICK_DEPTHS_MM,
    compare_open_loop,
    steps,
)
from benchmarks.against_peers.open_loop_figure import draw_open_loop, open_loop_table

DEEP = -1
"""The deepest press, 0.2 mm."""
PERCENT = 100 * ERROR


@pytest.fixture(scope="module")
def steps_done() -> list[str]:
    return []


@pytest.fixture(scope="module")
def figures(steps_done: list[str]) -> dict[str, Any]:
    return compare_open_loop(steps_done.append, quick=True)


def peak(figures: dict[str, Any], kind: str, method: str, level: int = DEEP) -> float:
    return float(figures["errors"][kind][method][level]["peak_error_percent"])


def change(figures: dict[str, Any], kind: str, method: str, level: int = DEEP) -> float:
    return peak(figures, kind, method, level) - peak(figures, "none", method, level)


@pytest.mark.parametrize("kind", ["sensor", "display", "distortion"])
def test_the_null_does_not_care(figures, kind):
    # a hundredth of what is planted; noise of the peak is 0.01 % of 0.2 mm
    assert abs(change(figures, kind, "null")) < 0.01 * PERCENT + 0.02


def test_the_null_is_right_with_every_error(figures):
    # nodes 1.4 mm apart read 0.2 % wrong by themselves (docs of the default run's test)
    assert all(abs(peak(figures, kind, "null")) < 0.3 for kind in ERRORS)
    for kind in ERRORS:
        assert figures["errors"][kind]["null"][DEEP]["residual_rms_px"] < 0.02


@pytest.mark.parametrize("level", range(len(QUICK_DEPTHS_MM)))
def test_open_loop_reads_the_sensors_gain(figures, level):
    # 2 % of what it reads, 3 to 6 % less than the press; that the lever changes with depth makes up 0.05 %
    reads = 1 + 0.01 * peak(figures, "none", "open", level)
    assert change(figures, "sensor", "open", level) == pytest.approx(PERCENT * reads, abs=0.1)


def test_open_loop_does_not_mind_the_display_either(figures):
    # phases are read at the carrier alone; harmonics fall on the window's zeros
    assert abs(change(figures, "display", "open")) < 0.05


def test_a_distortion_needs_the_rays_of_the_measured_rest(figures):
    zeros = figures["distortion_zeros"]
    for method in METHODS:
        rays, difference, rig = (zeros[z][method][DEEP] for z in ("rays", "difference", "rig"))
        assert difference["peak_error_percent"] - rays["peak_error_percent"] > 0.1
        # the rig's own rest takes the lens for a mirror bent by micrometres
        assert rig["rms_error_nm"] > 10_000
    assert zeros["difference"]["null"][DEEP]["rms_error_nm"] > 3 * zeros["rays"]["null"][DEEP]["rms_error_nm"]


def test_every_step_is_reported(figures, steps_done):
    assert len(steps_done) == steps(quick=True)
    assert steps_done[-1] == ""


def test_figures_are_written(figures, tmp_path):
    assert json.loads(json.dumps(figures, allow_nan=False)) == figures
    assert open_loop_table(figures).row_count == len(METHODS) * (len(ERRORS) + 2)
    path = tmp_path / "open-loop.png"
    draw_open_loop(figures, path)
    assert path.stat().st_size > 10_000


def test_a_press_that_was_never_nulled_is_marked(figures, tmp_path):
    lost = copy.deepcopy(figures)
    row = lost["errors"]["sensor"]["null"][DEEP]
    lost["errors"]["sensor"]["null"][DEEP] = dict.fromkeys(row) | {"depth_mm": row["depth_mm"], "frames": 0}
    cells = [cell for column in open_loop_table(lost).columns for cell in column.cells]
    assert cells.count("not\nnulled") == 1
    draw_open_loop(lost, tmp_path / "lost.png")
