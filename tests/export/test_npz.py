"""The .npz: planted maps, their places and times, and units that can be read off the file."""

import json

import numpy as np
import pytest

from zeromethod.export import Selection, prepare

ROUNDED = 1e-6
"""Relative: single precision keeps 24 bits."""


def test_maps_places_and_times_are_those_recorded(planted, recording, tmp_path):
    prepare(recording, tmp_path / "a.npz").write()
    with np.load(tmp_path / "a.npz", allow_pickle=False) as data:
        assert data["step"].tolist() == list(range(2, 10))
        assert data["time_s"] == pytest.approx(planted.time_s[1:], abs=1e-12)
        assert set(data["state"]) == {"locked"}
        for k, step in enumerate(data["step"]):
            x, y, valid = data["x_mm"][k], data["y_mm"][k], data["valid"][k]
            # Single precision of x and y moves the closed form by slope x 4 nm.
            assert data["depth_mm"][k][valid] == pytest.approx(
                planted.depth_at(step, x, y)[valid], rel=ROUNDED, abs=2e-7
            )
            assert data["slope"][k][valid] == pytest.approx(planted.slope_at(step, x, y)[valid], abs=2e-7)
        assert np.array_equal(np.isnan(data["depth_mm"]), ~data["valid"])
        assert data["contact"].sum() == 8 * 3 * 4
        rows, cols = len(data["v_px"]), len(data["u_px"])
        assert data["depth_mm"].shape == (8, rows, cols)
        assert data["slope"].shape == (8, rows, cols, 2)


def test_every_array_states_its_unit(recording, tmp_path):
    prepare(recording, tmp_path / "a.npz").write()
    with np.load(tmp_path / "a.npz", allow_pickle=False) as data:
        about = json.loads(str(data["about"]))
        assert set(about["arrays"]) == set(data.files)
        for name, said in about["arrays"].items():
            for suffix in ("mm", "px", "ns", "s"):
                if name.endswith(f"_{suffix}"):
                    assert said["unit"] == suffix
                    break
    assert about["arrays"]["slope"]["unit"] == "rad"
    assert "name" in about["rig"]


def test_a_part_of_the_time_and_every_other_frame(planted, recording, tmp_path):
    selection = Selection(from_s=0.04, to_s=0.2, every=2)
    assert prepare(recording, tmp_path / "a.npz", selection=selection).write()["times"] == 3
    with np.load(tmp_path / "a.npz") as data:
        # From step 3 (0.04 s) to step 8 (0.2 s), both ends included.
        assert data["step"].tolist() == [3, 5, 7]
