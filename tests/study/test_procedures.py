"""Figures of the packaged procedures against what is known otherwise."""

import pickle
from pathlib import Path
from typing import Any

import pytest

from zeromethod.study import parse_study
from zeromethod.study.runs import carry_out
from zeromethod.study.tasks import tasks

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


def test_a_run_reads_the_press_of_the_study() -> None:
    figures = outcome("run", "[press]\ndepth_mm = 0.02\nat_s = 0.06\n", frames=24)
    assert figures["truth.depth_peak_mm"] == pytest.approx(0.02, rel=1e-3)
    # nodes lie eight times further apart than the full camera's
    assert figures["depth_peak_mm"] == pytest.approx(0.02, rel=0.1)
    assert figures["locked_share"] > 0.3


def test_a_wrong_rig_file_shows_in_the_residual() -> None:
    right = outcome("run", 'press = "none"\n')
    wrong = outcome("run", 'press = "none"\n"bench.camera.roll_deg" = 1.0\n')
    assert wrong["residual_px_rms"] is None or wrong["residual_px_rms"] > 2 * right["residual_px_rms"]


def test_averaging_takes_noise_away_with_the_root_of_the_frames() -> None:
    noisy = 'press = "none"\n"camera.noise.read_grey" = 8.0\naveraged_frames = '
    one, sixteen = (outcome("averaging", noisy + count) for count in ("1", "16"))
    assert sixteen["averaged_s"] == pytest.approx(16 / 60)
    assert one["stated_depth_rms_nm"] / sixteen["stated_depth_rms_nm"] == pytest.approx(4.0, rel=0.1)
    # a map's rms is a few long waves': it scatters by some 30 %
    assert one["depth_rms_nm"] / sixteen["depth_rms_nm"] > 2.0


def test_fold_limits_agree_with_the_curvature_alone() -> None:
    text = 'schema_version = 1\ntitle = "t"\nprocedure = "design"\n[set]\nsize_mm = 2.0\n'
    (task,) = tasks(parse_study(text, Path("s.toml")))
    figures = carry_out(task)["figures"]
    # the limit of the first order against exact rays, searched to 3 %, at nodes half a millimetre apart
    assert figures["fold_mm"] == pytest.approx(figures["closed_form_mm"], rel=0.15)
    assert figures["nulled_mm"] <= figures["fold_mm"]


def test_more_evidence_leaves_less_error_of_depth() -> None:
    text = (
        'schema_version = 1\ntitle = "t"\nprocedure = "depth_error"\n[rig]\nbinning = 8\n[set]\n'
        'target.period_px = 8\n[grid]\nevidence = ["calipers", "rest map, 3 presses"]\n'
    )
    found = [carry_out(task) for task in tasks(parse_study(text, Path("s.toml")))]
    percent = [one["figures"]["depth_percent"] for one in found]
    assert percent[1] < 1.0 < percent[0]


@pytest.mark.parametrize(
    ("procedure", "setting", "message"),
    [
        ("depth_error", 'exact = "all"', 'exact: "all": nothing, LCD\'s pose'),
        ("depth_error", 'evidence = "hope"', 'evidence: "hope": one of calipers'),
        ("design", 'shape = "star"', "star"),
    ],
)
def test_settings_of_a_procedure_that_are_none_fail_the_run(
    procedure: str, setting: str, message: str
) -> None:
    (task,) = tasks(parse_study(SMALL.format(procedure=procedure, frames=2) + setting, Path("s.toml")))
    found = carry_out(task)
    assert found["figures"] is None
    assert message in found["failure"]
