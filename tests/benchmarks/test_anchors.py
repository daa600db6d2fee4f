"""The constant's figures against another version's, with few dents of few families."""

import json

import pytest
from command_line import run

from benchmarks import anchors
from benchmarks.anchors import CASES, OFF, OTHERS_ERROR, SILENT, STATED, command


@pytest.fixture
def few(monkeypatch):
    """A ball on a half-space and on a layer."""
    ball = [case for case in CASES if case.family.name == "ball"]
    monkeypatch.setattr(anchors, "CASES", ball)


def test_families_are_read_by_each_body_and_held_against_another_version(few, tmp_path):
    first, second = tmp_path / "first.json", tmp_path / "second.json"
    run("--dents 2 --held-out tests --summary", first, command=command)
    code, _, _ = run("--dents 2 --held-out tests --against", first, "--summary", second, command=command)
    assert code in (0, 1)
    rows = json.loads(second.read_text())["data"]["rows"]
    assert {f"{STATED}: ball", f"{SILENT}: ball", f"{SILENT}: ball, layer", f"{OFF}: ball, layer"} <= set(
        rows
    )
    # the same version has the same errors
    figures = {f["name"]: f["number"] for f in json.loads(second.read_text())["figures"]}
    assert figures[f"{STATED}: {OTHERS_ERROR}, worst family"] == pytest.approx(1.0)


def test_another_versions_dents_must_be_the_same(few, tmp_path):
    file = tmp_path / "first.json"
    run("--dents 2 --held-out tests --summary", file, command=command)
    code, _, err = run("--dents 3 --held-out tests --against", file, command=command)
    assert code == 2
    assert "of other scenes" in err
