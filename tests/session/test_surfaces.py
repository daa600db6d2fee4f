"""Surfaces read by a process of its own: the same ones, and what becomes of it when that process is gone."""

import os
import signal
import subprocess
import sys
import threading
import time
from contextlib import contextmanager
from dataclasses import fields, replace

import numpy as np
import pytest
from hanging import PATIENCE_S, eventually
from processes import has_ended
from surface_bench import Bench, Gauss, small_rig

from zeromethod import InputError, SurfaceReader, peak
from zeromethod.child_process import NICENESS
from zeromethod.session import surfaces as process_module
from zeromethod.session.surfaces import ReadingLost, SurfaceProcess


@pytest.fixture(scope="module")
def bench():
    return Bench(small_rig())


@pytest.fixture(scope="module")
def warp(bench):
    return bench.warp(Gauss(0.05, bench.centre_mm, 0.0, 2.0))


@pytest.fixture(scope="module")
def process(bench):
    """One for tests that leave it as it was."""
    with own_process(bench) as shared:
        yield shared


@contextmanager
def own_process(bench):
    process = SurfaceProcess(bench.rig, bench.grid)
    try:
        yield process
    finally:
        process.close()


@pytest.mark.parametrize("ahead", [False, True], ids=["in turn", "sent ahead"])
def test_the_same_warps_give_the_same_surfaces_bit_for_bit(bench, warp, ahead):
    """Each starts from the one before, and a reader's weights remember all of them."""
    lost = replace(warp, flags=warp.flags.copy())
    lost.flags[20:24, 20:24] = 1
    here = SurfaceReader(bench.rig, bench.optics, bench.grid)
    with own_process(bench) as process:
        if ahead:
            process.begin(warp)
        for one, following in ((warp, lost), (lost, warp), (warp, lost)):
            if ahead:
                process.begin(following)
            there, there_peak = process.read(one)
            surface = here.follow(one)
            assert there_peak == peak(surface)
            for field in fields(surface):
                mine, theirs = getattr(surface, field.name), getattr(there, field.name)
                if isinstance(mine, np.ndarray):
                    assert mine.dtype == theirs.dtype
                    assert mine.tobytes() == theirs.tobytes(), field.name
            assert np.isfinite(there.depth_mm).sum() > 100


@pytest.mark.skipif(sys.platform != "linux", reason="niceness is as Linux counts it")
def test_it_leaves_the_cores_to_the_loop_once_it_has_started(process, warp):
    process.read(warp)
    process.read(warp)  # it lowers its priority after its first answer
    own = os.getpriority(os.PRIO_PROCESS, 0)
    assert os.getpriority(os.PRIO_PROCESS, process.process_id) == max(NICENESS, own)
    # within one session, or niceness would not count against the loop where the system groups by sessions
    assert os.getsid(process.process_id) == os.getsid(0)


def test_what_reading_raises_is_raised_and_the_next_is_read(process, warp):
    with pytest.raises(InputError, match=r"warp\.q: shape .*: must be") as caught:
        process.read(replace(warp, q=warp.q[1:]))
    # where it went wrong over there
    assert "reader.py" in "".join(caught.value.__notes__)
    assert process.read(warp)[0].valid.any()


def test_a_process_that_was_killed_is_reported_at_once(bench, warp):
    with own_process(bench) as process:
        process.read(warp)
        os.kill(process.process_id, signal.SIGKILL)
        for _ in range(2):
            with pytest.raises(ReadingLost, match=f"signal {signal.SIGKILL:d}"):
                process.read(warp)


def test_a_process_that_stands_still_is_given_up(bench, warp, monkeypatch):
    with own_process(bench) as process:
        process.read(warp)
        process.give_up_if_late()  # nothing is asked of it
        process.read(warp)
        monkeypatch.setattr(process_module, "PATIENCE_S", 0.05)
        os.kill(process.process_id, signal.SIGSTOP)
        over = threading.Event()

        def watch():
            while not over.wait(0.02):
                process.give_up_if_late()

        watching = threading.Thread(target=watch)
        watching.start()
        with pytest.raises(ReadingLost, match=r"a reading took more than 0\.05 s"):
            process.read(warp)
        over.set()
        watching.join()


def test_closing_ends_a_reading_under_way(bench, warp):
    process = SurfaceProcess(bench.rig, bench.grid)
    process.read(warp)
    os.kill(process.process_id, signal.SIGSTOP)
    reasons = []

    def read():
        try:
            process.read(warp)
        except ReadingLost as why:
            reasons.append(str(why))

    reading = threading.Thread(target=read)
    reading.start()
    eventually(lambda: process._asked_s is not None)
    process.close()
    process.close()
    reading.join(PATIENCE_S)
    assert reasons == ["it was ended"]


PARENT = """
import sys
sys.path[:] = {path!r}
from pathlib import Path
from zeromethod.session.surfaces import SurfaceProcess
from surface_bench import Bench, Gauss, small_rig
bench = Bench(small_rig())
process = SurfaceProcess(bench.rig, bench.grid)
process.read(bench.warp(Gauss(0.05, bench.centre_mm, 0.0, 2.0)))
print(process.process_id, flush=True)
input()
"""


def test_it_ignores_ctrl_c_and_ends_when_its_parent_was_killed():
    parent = subprocess.Popen(
        [sys.executable, "-c", PARENT.format(path=[os.getcwd(), *sys.path])],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
    )
    with parent:
        process_id = int(parent.stdout.readline())
        os.kill(process_id, signal.SIGINT)
        time.sleep(0.1)
        assert not has_ended(process_id)
        assert os.getpgid(process_id) != os.getpgid(parent.pid)
        parent.kill()
    eventually(lambda: has_ended(process_id))
