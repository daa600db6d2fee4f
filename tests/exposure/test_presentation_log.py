import numpy as np
import pytest

from zeromethod.exposure.presentation_log import PresentationLog


def warp(value: float) -> np.ndarray:
    return np.full((3, 4, 2), value)


def test_entries_come_back_in_order_oldest_first():
    log = PresentationLog((3, 4), capacity=4)
    for k in range(3):
        log.record(10 * k, warp(k))
    assert log.times_ns().tolist() == [0, 10, 20]
    assert [log.warp(k)[0, 0, 0] for k in range(3)] == [0, 1, 2]
    assert log.complete


def test_the_oldest_entry_is_overwritten_when_the_ring_is_full():
    log = PresentationLog((3, 4), capacity=4)
    for k in range(7):
        log.record(10 * k, warp(k))
    assert log.times_ns().tolist() == [30, 40, 50, 60]
    assert [log.warp(k)[0, 0, 0] for k in range(4)] == [3, 4, 5, 6]
    assert len(log) == 4
    assert not log.complete


def test_the_log_keeps_its_own_copy():
    log = PresentationLog((3, 4))
    q = warp(1)
    log.record(0, q)
    q[:] = 9
    assert log.warp(0)[0, 0, 0] == 1


def test_time_must_not_run_backwards():
    log = PresentationLog((3, 4))
    log.record(100, warp(0))
    with pytest.raises(ValueError, match="before the picture"):
        log.record(99, warp(1))
