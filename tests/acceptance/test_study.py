"""200 short runs give one table: on processes, on a Dask cluster, with a worker killed in the middle."""

import os
import signal
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pyarrow.parquet
import pytest

from zeromethod.study import Cluster, LocalPool, Study, conduct, parse_study
from zeromethod.study.conduct import TABLE

RUNS = 200

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


def kill_in_the_middle() -> Callable[[dict[str, Any]], None]:
    """Kill the worker that a run came from, once a third of the runs are done."""
    count = 0

    def look(outcome: dict[str, Any]) -> None:
        nonlocal count
        count += 1
        if count == RUNS // 3:
            os.kill(outcome["worker"]["pid"], signal.SIGKILL)

    return look


@pytest.fixture
def cluster() -> Iterator[str]:
    distributed = pytest.importorskip("distributed")
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=":0", silence_logs=50
    ) as running:
        yield running.scheduler_address


def test_processes_and_cluster_give_the_same_table_though_workers_die(
    study: Study, tmp_path: Path, cluster: str
) -> None:
    workers: dict[str, set[int]] = {"local": set(), "dask": set()}
    for name, executor in (("local", LocalPool(2)), ("dask", Cluster(cluster))):
        kill = kill_in_the_middle()

        def note(outcome: dict[str, Any], name: str = name, kill: Any = kill) -> None:
            workers[name].add(outcome["worker"]["pid"])
            kill(outcome)

        results = conduct(study, tmp_path / name, executor, on_outcome=note)
        assert results.failures == []
    # two workers, and the one that took the place of the killed one
    assert {name: len(pids) for name, pids in workers.items()} == {"local": 3, "dask": 3}
    table = pyarrow.parquet.read_table(tmp_path / "local" / TABLE)
    assert table.num_rows == RUNS
    assert table["run"].to_pylist() == list(range(RUNS))
    # every run is one of its own
    assert len(set(table["residual_end_px"].to_pylist())) == RUNS
    assert table["residual_end_px"].null_count == 0
    assert (tmp_path / "local" / TABLE).read_bytes() == (tmp_path / "dask" / TABLE).read_bytes()
