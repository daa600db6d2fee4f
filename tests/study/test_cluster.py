"""A Dask cluster that has no workers yet, and one whose worker hangs."""

import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from zeromethod.study import Cluster, Study, conduct

distributed = pytest.importorskip("distributed")
Squares = Callable[..., Study]


@pytest.fixture
def empty(own: None) -> Iterator[Any]:
    """A scheduler without workers."""
    with distributed.LocalCluster(
        n_workers=0, threads_per_worker=1, processes=True, dashboard_address=":0", silence_logs=50
    ) as running:
        yield running


def test_a_cluster_without_workers_is_told_of_and_goes_on_when_one_comes(
    empty: Any, squares: Squares, tmp_path: Path
) -> None:
    told_s: list[float] = []
    lines: list[str] = []

    def tell(line: str) -> None:
        told_s.append(time.monotonic() - started)
        lines.append(line)
        threading.Thread(target=empty.scale, args=(1,)).start()

    study = squares(4, "waits_at = 2", f'mark = "{tmp_path / "waiting"}"', limit_s=5.0)
    started = time.monotonic()
    results = conduct(study, tmp_path, Cluster(empty.scheduler_address, tell))
    address = empty.scheduler_address
    assert lines == [f"--cluster: {address}: no worker yet, waiting for one: dask worker {address}"]
    assert told_s[0] < 10.0
    # the run that hangs is given up, and those after it find a worker
    assert [(row["run"], row["failure"]) for row in results.failures] == [
        (2, "took longer than limit_s = 5 s, and was ended")
    ]
    assert [row["square"] for row in results.rows if row["run"] != 2] == [0, 1, 9]
    assert time.monotonic() - started < 50.0
