"""The peak's track as CSV."""

import csv

import pytest

from zeromethod.export import prepare


def test_one_line_per_step_empty_where_nothing_was_read(planted, recording, tmp_path):
    assert prepare(recording, tmp_path / "a.csv").write() == {"times": 9, "peaks": 8}
    with (tmp_path / "a.csv").open(newline="") as file:
        lines = list(csv.DictReader(file))
    sigmas = ["x_sigma_mm", "y_sigma_mm"]
    assert list(lines[0]) == [
        "time_s",
        "depth_mm",
        "depth_sigma_mm",
        "x_mm",
        "y_mm",
        *sigmas,
        "total_force_n",
        "sigma_total_force_n",
        "state",
        "where",
        "damaged",
    ]
    assert [lines[0][name] for name in ("depth_mm", "x_mm", "state")] == ["", "", "starting"]
    assert [float(line["time_s"]) for line in lines] == pytest.approx(planted.time_s)
    # Numbers come back as they were, to the last bit.
    assert [float(line["depth_mm"]) for line in lines[1:]] == planted.depth_mm[1:].tolist()
    assert {line["total_force_n"] for line in lines} == {""}  # nothing touches
    assert [line["where"] for line in lines] == ["", *["measured"] * 8]
    assert {(line["x_mm"], line["y_mm"], line["state"]) for line in lines[1:]} == {("42.0", "3.0", "locked")}
