"""The peak of a dent comes back whole, from the narrowest that the nodes resolve to wider than the view."""

from typing import Any

import pytest

from benchmarks import wavelength_gain as gain
from zeromethod.rig.load import load_rig


@pytest.fixture(scope="module")
def bench() -> Any:
    return gain.Bench(load_rig("simulated"))


@pytest.mark.parametrize("nodes", [4, 6, 8, 16, 32, 64])
def test_reading_alone_has_gain_one(bench: Any, nodes: int) -> None:
    mirror = bench.mirror(nodes * bench.pitch_mm)
    read, _ = bench.gain(bench.reader.read(bench.exact_warp(mirror)), mirror)
    assert read == pytest.approx(1.0, abs=gain.WITHIN)


def test_the_loop_has_gain_one_for_the_narrowest(bench: Any) -> None:
    read = gain.gain_at(bench, 4, frames=6)
    assert read.locked_frames == 6
    assert read.loop == pytest.approx(1.0, abs=gain.WITHIN)
