"""Against plain arctangent and unwrapping on the same frames: never worse, whatever is lit or cropped."""

import numpy as np
import pytest
from decoding.planted import Bench

from benchmarks.decoding import LADDERS
from benchmarks.fringe_bench import PANEL, FringeBench, linearised
from benchmarks.peers.hierarchical_unwrapping import places
from zeromethod.decoding import Reason
from zeromethod.decoding.fringes import FringeSequence, equal_shifts
from zeromethod.decoding.measuring import RestMeasurement, measure_rest
from zeromethod.decoding.noise import NoiseModel
from zeromethod.decoding.periods import choose_periods


def compare(bench: FringeBench, frames: np.ndarray, cropped: bool) -> RestMeasurement:
    """Places no worse than the peer's, none lost, none outside the mirror, errors as sigma says."""
    window = bench.window if cropped else np.s_[:, :]
    truth, mirror = bench.truth[window], bench.mirror[window]
    seen = np.ascontiguousarray(frames[(slice(None), *window)])
    found = measure_rest(seen, bench.sequence, size_px=PANEL)
    rest = found.rest_map
    off, plain = rest.lcd_px - truth, places(seen, bench.periods_px) - truth
    both = rest.valid & mirror
    # a hundredth may have noise so far out that a pixel counts as dead
    assert both.sum() > 0.99 * mirror.sum()
    assert not (rest.valid & ~mirror).any()
    assert np.sqrt(np.mean(off[both] ** 2)) <= np.sqrt(np.mean(plain[both] ** 2))
    # sigma comes from the scatter of a thousand pixels or more: known to some percent
    assert np.std(off[both] / rest.sigma_px[both]) == pytest.approx(1.0, abs=0.1)
    return found


@pytest.mark.parametrize("ladder", LADDERS, ids=len)
@pytest.mark.parametrize("cropped", [False, True])
def test_places_are_never_worse_than_plain_ones(ladder, cropped):
    bench = FringeBench(ladder, shape=(180, 240))
    frames = bench.frames()
    compare(bench, frames, cropped)
    compare(bench, linearised(frames), cropped)


@pytest.mark.parametrize("lit", [0.03, 1.0])
def test_the_dark_share_of_the_image_does_not_matter(lit):
    bench = FringeBench(LADDERS[1], shape=(240, 320) if lit < 1 else (90, 120), lit=lit)
    frames = bench.frames()
    compare(bench, frames, False)
    compare(bench, linearised(frames), False)


def test_the_harmonic_of_three_shifts_is_taken_out_of_the_finest_period_too():
    bench = FringeBench(LADDERS[1], shifts=3, shape=(180, 240), lit=0.6)
    found = compare(bench, bench.frames(), True)
    # Second over first harmonic of (1/2 + 0.48 cos)^2.2, in the coarse periods that no blur damps.
    turn = 2 * np.pi * np.arange(64) / 64
    waves = np.fft.rfft((0.5 + 0.48 * np.cos(turn)) ** 2.2).real
    assert found.folded_harmonic == pytest.approx(waves[2] / waves[1], abs=0.005)


def test_a_harmonic_that_is_not_there_is_not_taken_out():
    sequence = FringeSequence(LADDERS[1], equal_shifts(4))
    found = measure_rest(Bench((96, 120)).frames(sequence), sequence, size_px=PANEL)
    # Three standard deviations of 0.03 rad over 5000 pixels, four times that where coarse judges fine.
    assert found.folded_harmonic < 0.006


def test_a_second_reflection_shows_in_a_ladder_too():
    sequence = FringeSequence(LADDERS[1], equal_shifts(4))
    doubled = np.zeros((128, 160), bool)
    doubled[:, 100:] = True
    bench = Bench(ghost=0.2 * doubled)
    rest = measure_rest(bench.frames(sequence), sequence, size_px=PANEL).rest_map
    named = (rest.reason & int(Reason.SECOND_REFLECTION)) != 0
    assert named[:, 105:].mean() > 0.9
    assert not named[:, :95].any()


def test_each_axis_may_have_its_own_periods():
    columns, rows = (190.0, 40.0, 16.0), (130.0, 20.0)
    sequence = FringeSequence(columns, equal_shifts(4), ("rows", "columns"), 2, rows)
    assert sequence.frames == 2 * (3 + 2) * 4
    light = [200 * picture for picture in sequence.pictures(160, 96)]
    rest = measure_rest(light, sequence, size_px=(160, 96), noise=NoiseModel.of_camera(0.5)).rest_map
    at = np.stack(np.meshgrid(np.arange(160), np.arange(96)), axis=-1)
    # Seen pixel by pixel, the LCD's own pixel numbers come back; light is kept as float32.
    assert np.abs(rest.lcd_px - at).max() < 1e-3


def test_the_last_search_finds_what_the_neighbour_cannot_say():
    # Every second pixel looks half the LCD away: no pixel's order follows from the one before.
    sequence = FringeSequence(choose_periods(PANEL[0]), equal_shifts(4))
    bench = Bench((40, 60))
    bench.lcd[:, ::2, 0] += 640.0
    found = measure_rest(bench.frames(sequence), sequence, size_px=PANEL)
    off = np.abs(found.rest_map.lcd_px - bench.lcd)[found.rest_map.valid]
    assert off.max(initial=0.0) < 1.0
