"""A folder of recordings, read again."""

from pathlib import Path

import pytest
from recorded_run import recorded

from zeromethod.errors import InputError
from zeromethod.study import parse_study
from zeromethod.study.runs import carry_out
from zeromethod.study.tasks import tasks

STUDY = """
schema_version = 1
title = "again"
procedure = "from_warps"
recordings = ["day/*.h5"]

[grid]
surface.known_rest = [[], [{ x_mm = [20.0, 34.0], y_mm = [-10.0, 10.0] }]]
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("recordings")
    (folder / "day").mkdir()
    recorded(folder / "day" / "run.h5", 0.5)
    return folder


def test_unchanged_settings_read_the_recorded_depths(folder):
    same, other = tasks(parse_study(STUDY, folder / "s.toml"))
    figures = carry_out(same)["figures"]
    assert figures["change_rms_um"] == 0.0
    assert figures["recorded_rig"] == "simulated"
    # the press of 0.2 mm came down 0.3 s before the end: what presses is learned by then
    assert figures["deepest_mm"] == pytest.approx(0.2, rel=0.05)
    anchored = carry_out(other)["figures"]
    assert anchored["frames"] == figures["frames"] > 5
    assert anchored["change_rms_um"] > 0.0


def test_what_is_no_recording_fails_its_run_alone(folder):
    (folder / "day" / "zz.h5").write_text("no")
    found = [carry_out(task) for task in tasks(parse_study(STUDY, folder / "s.toml"))[::2]]
    (folder / "day" / "zz.h5").unlink()
    assert found[0]["failure"] is None
    assert "zz.h5" in found[1]["failure"]


def test_settings_are_checked_before_a_recording_is_opened(folder):
    with pytest.raises(
        InputError, match=r's\.toml: grid: "surface\.known": unknown key: did you mean surface\.known_rest\?'
    ):
        tasks(parse_study(STUDY.replace("known_rest", "known"), folder / "s.toml"))
