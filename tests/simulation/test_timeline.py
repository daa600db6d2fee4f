"""Seeded clocks."""

import numpy as np
import pytest

from zeromethod.simulation.timeline import Timeline


def test_events_without_jitter_are_exact():
    line = Timeline(rate_hz=50.0, phase=0.25)
    assert [line.time_ns(k) for k in (-1, 0, 1, 1000)] == [-15_000_000, 5_000_000, 25_000_000, 20_005_000_000]


def test_jitter_depends_on_seed_stream_and_index_alone():
    line = Timeline(60.0, 0.3, 1e-4, seed=5, stream=1)
    forwards = [line.time_ns(k) for k in range(-3, 50)]
    backwards = [line.time_ns(k) for k in reversed(range(-3, 50))][::-1]
    assert forwards == backwards
    assert forwards != [Timeline(60.0, 0.3, 1e-4, seed=6, stream=1).time_ns(k) for k in range(-3, 50)]
    assert forwards != [Timeline(60.0, 0.3, 1e-4, seed=5, stream=2).time_ns(k) for k in range(-3, 50)]


def test_jitter_has_its_sigma_and_no_mean():
    line, plain = Timeline(60.0, 0.0, 1e-4), Timeline(60.0)
    jitter_s = np.array([line.time_ns(k) - plain.time_ns(k) for k in range(2000)]) * 1e-9
    assert jitter_s.std() == pytest.approx(1e-4, rel=0.05)  # 3 sigma of an estimate from 2000: 4.7 %
    assert abs(jitter_s.mean()) < 3 * 1e-4 / np.sqrt(2000)


def test_order_is_kept_however_large_the_jitter():
    line = Timeline(60.0, 0.0, 1.0)
    assert np.all(np.diff([line.time_ns(k) for k in range(500)]) > 0)


def test_first_after_is_strict_and_last_until_is_not():
    line = Timeline(59.94, 0.3, 2e-4, seed=1)
    for k in (0, 7, 1234, 600_000):
        time_ns = line.time_ns(k)
        assert line.first_after(time_ns) == k + 1
        assert line.first_after(time_ns - 1) == k
        assert line.last_until(time_ns) == k
        assert line.last_until(time_ns - 1) == k - 1
