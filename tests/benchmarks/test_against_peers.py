from dataclasses import replace

import numpy as np
import pytest
from scipy import ndimage

from benchmarks.against_peers import bars
from benchmarks.against_peers.bound import bound_px, measured_window_power, tile_px
from benchmarks.against_peers.frames import CROSSED, PERIOD_PX, SIGMA_GREY, noisy, stepped
from benchmarks.against_peers.integration import INTEGRATORS
from benchmarks.against_peers.methods import CONTENDERS, RESIDUAL, phase_shifting
from benchmarks.against_peers.scaling import integration_task
from zeromethod.sensing.window import transfer

SHAPE = (512, 640)


def test_the_planted_gradient_is_what_the_bound_takes_it_for():
    for pattern in (CROSSED, stepped(4)):
        step = np.full((PERIOD_PX, PERIOD_PX, 2), [1e-3, 0.0])
        change = (pattern.light_grey(step).astype(float) - pattern.light_grey(-step)) / 2e-3
        # float32 grey of 200 is good to 1e-5, over 2e-3 px: 0.5 % of the gradient of 13 grey per px.
        assert np.sum(np.mean(change**2, axis=(1, 2))) == pytest.approx(pattern.information()[0], rel=0.01)


@pytest.mark.parametrize("width_px", [3, 7])
def test_a_known_linear_window_is_measured_as_it_is(width_px):
    # Phase shifting followed by a box average: w = 1 / width^2 over the box, sum w^2 = 1 / width^2.
    plain = phase_shifting(4)(SHAPE)

    def averaged(frames):
        return ndimage.uniform_filter(plain.read(frames), (width_px, width_px, 0))

    boxed = replace(plain, read=averaged)
    power = measured_window_power(boxed, SHAPE, 3, np.random.default_rng(0))
    # The standard error of 3 realisations of 255^2 frequencies is below 1 %; sin(d) for d makes 1 % more.
    assert power.value == pytest.approx(1 / width_px**2, rel=0.03)
    assert power.error < 0.02 * power.value


def test_the_residual_has_the_window_that_it_is_made_of_and_reaches_its_bound():
    contender, rng = CONTENDERS[RESIDUAL](SHAPE), np.random.default_rng(0)
    power = measured_window_power(contender, SHAPE, 16, rng)
    # Triangle over both axes; along the carrier its own double frequency at the nodes takes part.
    tile = tile_px(SHAPE)
    lines = np.arange(-tile // PERIOD_PX + 1, tile // PERIOD_PX) / tile
    plain = transfer(PERIOD_PX, lines)
    doubled = 0.5 * (transfer(PERIOD_PX, lines + 2 / PERIOD_PX) + transfer(PERIOD_PX, lines - 2 / PERIOD_PX))
    expected = np.sum((plain - doubled) ** 2) * np.sum(plain**2) / tile**2
    assert power.value == pytest.approx(expected, abs=4 * power.error)
    assert power.error < 0.02 * expected
    light = CROSSED.light_grey(np.zeros((*SHAPE, 2)))
    reads = [contender.read(noisy(light, SIGMA_GREY, rng)).copy() for _ in range(8)]
    noise = np.sqrt(np.mean(np.var(reads, axis=0, ddof=1)))
    # 4500 nodes x 2 x 7, correlated over 5 nodes: 1 % rms; the bound's own 1 %.
    assert 0.95 < noise / bound_px(power.value, CROSSED) < 1.1


@pytest.mark.parametrize("name", list(INTEGRATORS))
def test_every_integrator_returns_the_planted_press(name):
    task = integration_task((256, 320))
    # Press of sigma 5.3 nodes; the trapezoid rule, worst of them, leaves 1 / (12 x 5.3^2) = 0.3 %.
    assert task.error_percent(INTEGRATORS[name](task)(task.slope)) < 0.3


def test_bars_are_judged_only_on_what_was_measured():
    assert bars({}) == []
    found = {"noise_of_bound": 1.2, "error_of_bound": 1.0, "null": {"of_dis_fast": 0.1}}
    judged = bars({"displacement": {"methods": {RESIDUAL: found}}})
    assert [bar["met"] for bar in judged] == [False, True, True]
