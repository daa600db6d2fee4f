"""Short runs give one table: on local workers, on a Dask cluster, with a worker killed in the middle."""

import os
import signal
from collections.abc import Iterator
from pathlib import Path

import pyarrow.parquet
import pytest

from zeromethod.study import Progress, Study, Workers, parse_study, run_study
from zeromethod.study.results import TABLE

RUNS = 16

# 64 x 64 camera pixels, a small LCD, the frames before and after the touch: some 0.1 s for a run
STUDY = f"""
schema_version = 1
title = "short runs"
seed = 5
repeats = {RUNS // 8}
frames = 3
metrics = ["state", "residual_end_px", "valid_share", "untouched.depth_rms_nm"]

[rig]
binning = 8

[set]
"camera.columns" = 512
"camera.rows" = 512
"camera.centre_px" = [255.5, 255.5]
"target.period_px" = 8
"display.columns" = 240
"display.rows" = 135
"display.pitch_mm" = 0.504

[press]
at_s = 0.03

[grid]
"control.gain" = [0.25, 0.5, 0.75, 1.0]
"control.controller" = ["composition", "integrator"]

[random]
"camera.noise.read_grey" = {{ uniform = [0.5, 4.0] }}
"press.depth_mm" = {{ normal = [0.01, 0.002] }}
"""


@pytest.fixture
def study() -> Study:
    return parse_study(STUDY, Path("short.toml"))


@pytest.fixture
def cluster() -> Iterator[str]:
    distributed = pytest.importorskip("distributed")
    with distributed.LocalCluster(
        n_workers=1, threads_per_worker=1, processes=True, dashboard_address=":0", silence_logs=50
    ) as running:
        yield running.scheduler_address


def test_processes_and_cluster_give_the_same_table_though_workers_die(study, tmp_path, cluster):
    pids: dict[str, set[int]] = {"local": set(), "dask": set()}
    for name, workers in (("local", Workers(2)), ("dask", Workers(address=cluster))):

        def kill_in_the_middle(now: Progress, name: str = name) -> None:
            if now.outcome is not None:
                pids[name].add(now.outcome["worker"]["pid"])
                if now.done == RUNS // 3:
                    os.kill(now.outcome["worker"]["pid"], signal.SIGKILL)

        results = run_study(study, tmp_path / name, workers, on_progress=kill_in_the_middle)
        assert results.failures == []
    # The one worker there was replaced. Of the two here the one that is left may be done with everything
    # before a new one has started: how many took part is a matter of time.
    assert len(pids["dask"]) == 2
    assert len(pids["local"]) >= 2
    table = pyarrow.parquet.read_table(tmp_path / "local" / TABLE)
    assert table.num_rows == RUNS
    assert table["run"].to_pylist() == list(range(RUNS))
    # every run is one of its own
    assert len(set(table["residual_end_px"].to_pylist())) == RUNS
    assert table["residual_end_px"].null_count == 0
    assert (tmp_path / "local" / TABLE).read_bytes() == (tmp_path / "dask" / TABLE).read_bytes()
