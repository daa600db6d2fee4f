"""Figures of the packaged procedures, against planted truth and closed forms."""

import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from zeromethod.loop.state import LOCK_FRAMES, LOCK_RESIDUAL_PX
from zeromethod.study import parse_study
from zeromethod.study.runs import carry_out
from zeromethod.study.tasks import tasks
from zeromethod.warp.grid import NodeGrid

SMALL = """
schema_version = 1
title = "small"
frames = {frames}
procedure = "{procedure}"
[rig]
binning = 8
[set]
"camera.columns" = 1024
"camera.centre_px" = [511.5, 511.5]
"display.columns" = 240
"display.rows" = 135
"display.pitch_mm" = 0.504
"""


def outcome(procedure: str, text: str, frames: int = 6) -> dict[str, Any]:
    (task,) = tasks(parse_study(SMALL.format(procedure=procedure, frames=frames) + text, Path("s.toml")))
    found = carry_out(pickle.loads(pickle.dumps(task)))
    assert found["failure"] is None, found
    figures: dict[str, Any] = found["figures"]
    return figures


def test_a_run_reads_the_press_of_the_study():
    # what presses is known two dozen frames after it came, at most
    figures = outcome("run", "[press]\ndepth_mm = 0.02\nat_s = 0.06\n", frames=44)
    assert figures["truth.depth_peak_mm"] == pytest.approx(0.02, rel=1e-3)
    # the worst frame states 7 um: for a dozen frames it is not known what the press leaves at the border
    assert figures["depth_peak_sigma_mm"] < 0.5 * 0.02
    assert figures["depth_peak_mm"] == pytest.approx(0.02, abs=4 * figures["depth_peak_sigma_mm"])
    # the delay of 2.6 frames twice, and 4; once nulled it stays so to the end of the 40 frames of the hold
    assert figures["lock_frames"] <= 9
    locked = 40 - (figures["lock_frames"] - 1) - (LOCK_FRAMES - 1)
    assert figures["nulled_frames"] == locked
    assert figures["locked_share"] == pytest.approx(locked / 40)


def test_a_wrong_rig_file_shows_in_the_first_residual_and_in_the_state():
    press, rolled_deg = 'scenario = "none"\n', 1.0
    rolled = f'{press}"bench.camera.roll_deg" = {rolled_deg}\n'
    # the first frame that is lit: the image is turned about its middle
    grid = NodeGrid((128, 128), 16)
    u, v = (one[grid.inner] - 63.5 for one in grid.mesh())
    turned_px = np.radians(rolled_deg) * np.sqrt(np.mean(u**2 + v**2))
    assert outcome("run", press, frames=3)["residual_px_rms"] < LOCK_RESIDUAL_PX
    assert outcome("run", rolled, frames=3)["residual_px_rms"] == pytest.approx(turned_px, rel=0.02)
    # the loop nulls it like any other displacement, but the bench is named, and no depth of it is a figure
    right, wrong = (outcome("run", text, frames=12) for text in (press, rolled))
    assert (right["state"], wrong["state"]) == ("resting", "bench moved")
    assert wrong["residual_end_px"] == pytest.approx(right["residual_end_px"], rel=0.2)
    assert right["untouched.depth_rms_nm"] < 1e3
    assert wrong["untouched.depth_rms_nm"] is None
    assert wrong["depth_peak_mm"] is None


def test_averaging_takes_noise_away_with_the_root_of_the_frames():
    noisy = 'scenario = "none"\n"camera.noise.read_grey" = 8.0\naveraged_frames = '
    drawn, stated = {}, {}
    for count in (1, 16):
        seeds = [outcome("averaging", f'"simulation.seed" = {seed}\n{noisy}{count}\n') for seed in range(6)]
        assert seeds[0]["averaged_s"] == pytest.approx(count / 60)
        drawn[count], stated[count] = (
            np.sqrt(np.mean([one[name] ** 2 for one in seeds]))
            for name in ("depth_rms_nm", "stated_depth_rms_nm")
        )
    # one frame states its noise to 1 %, and six of them their mean; the anchor differs
    # 3.87: what weak loads may press is in it, which more frames do not take away as noise
    assert stated[1] / stated[16] == pytest.approx(4.0, rel=0.05)
    # the rms of a map is that of a few long waves: 25 % from seed to seed, 10 % for six, three of these
    assert drawn[1] / stated[1] == pytest.approx(1.0, rel=0.3)
    assert drawn[16] / stated[16] == pytest.approx(1.0, rel=0.3)


def test_fold_limits_agree_with_the_curvature_alone():
    text = 'schema_version = 1\ntitle = "t"\nprocedure = "design"\n[grid]\nsize_mm = [1.0, 2.0, 4.0]\n'
    found = [carry_out(task)["figures"] for task in tasks(parse_study(text, Path("s.toml")))]
    first_order = np.array([one["closed_form_mm"] for one in found])
    # curvature goes with depth over size squared
    np.testing.assert_allclose(first_order / first_order[0], [1.0, 4.0, 16.0], rtol=1e-6)
    # against exact rays, searched to 3 %: what the first order leaves out goes to 0 with the depth
    short = 1.0 - np.array([one["fold_mm"] for one in found]) / first_order
    assert abs(short[0]) < 0.03
    assert (np.diff(short) > 0).all()
    assert short[-1] < 0.15
    # below 4 LCD px per carrier period the picture is too fine for the LCD, which comes before the fold
    assert all(one["nulled_mm"] < one["fold_mm"] for one in found)
    assert {one["because"] for one in found} == {"too fine for the LCD"}


def test_more_evidence_leaves_less_error_of_depth():
    text = (
        'schema_version = 1\ntitle = "t"\nprocedure = "depth_error"\n[rig]\nbinning = 8\n[set]\n'
        "target.period_px = 8\n[grid]\n"
        'evidence = ["calipers", "rest map, press", "rest map, 3 presses"]\n'
    )
    found = [carry_out(task) for task in tasks(parse_study(text, Path("s.toml")))]
    calipers, one, three = (each["figures"]["depth_percent"] for each in found)
    # a press of 0.2 mm known to 1 um gives depth's scale where it is to 0.5 %, three their mean to 0.29 %
    assert 0.5 / np.sqrt(3) < three < 0.5 < one < 1.0 < calipers


@pytest.mark.parametrize(
    ("procedure", "setting", "reason"),
    [
        ("depth_error", 'exact = "all"', 'exact: "all": nothing, LCD\'s pose'),
        ("depth_error", 'evidence = "hope"', 'evidence: "hope": one of calipers'),
        ("design", 'shape = "star"', "star"),
    ],
)
def test_a_setting_that_the_procedure_does_not_have_fails_the_run(procedure, setting, reason):
    (task,) = tasks(parse_study(SMALL.format(procedure=procedure, frames=2) + setting, Path("s.toml")))
    found = carry_out(task)
    assert found["figures"] is None
    assert reason in found["failure"]
