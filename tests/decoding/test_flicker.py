"""Light that changes from frame to frame, planted: found, taken out, the rest of it in sigma."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.fringe_bench import PANEL, FringeBench
from benchmarks.peers.hierarchical_unwrapping import places
from zeromethod.decoding import measure_rest

LADDER = (2133.0, 640.0, 192.0, 58.0, 17.0)
BENCH = FringeBench(LADDER, shape=(180, 240), lit=0.6)


@pytest.mark.parametrize("shifts", [3, 4, 6])
def test_flicker_is_taken_out_and_what_is_left_is_in_sigma(shifts):
    off, pull, plain, shares = [], [], [], []
    for seed in range(4):
        bench = replace(BENCH, shifts=shifts, flicker=0.03, seed=seed)
        frames = bench.frames()
        found = measure_rest(frames, bench.sequence, size_px=PANEL)
        both = found.rest_map.valid & bench.mirror
        assert both.sum() > 0.98 * bench.mirror.sum()
        error = (found.rest_map.lcd_px - bench.truth)[both]
        off.append(error.ravel())
        pull.append((error / found.rest_map.sigma_px[both]).ravel())
        plain.append((places(frames, bench.periods_px) - bench.truth)[both].ravel())
        shares.append(found.flicker)
    # Two periods of each axis are seen in full, two components of each: 32 numbers in all, 13 %.
    assert np.sqrt(np.mean(np.square(shares))) == pytest.approx(0.03, rel=0.4)
    # Half of what is left is noise, the other half hangs on 16 of the same numbers.
    assert np.sqrt(np.mean(np.concatenate(pull) ** 2)) == pytest.approx(1.0, abs=0.3)
    assert np.std(np.concatenate(off)) < 0.8 * np.std(np.concatenate(plain))


def test_steady_light_does_not_flicker():
    for ladder in (LADDER, (2133.0, 256.0, 30.0)):
        bench = replace(BENCH, periods_px=ladder)
        assert measure_rest(bench.frames(), bench.sequence, size_px=PANEL).flicker == 0.0
