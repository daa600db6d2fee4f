"""Stated sigma and covariance against 400 draws of the pixels' noise, all the way to depth."""

from collections.abc import Callable
from types import ModuleType
from typing import Any

import numpy as np
import pytest

from zeromethod.thread_limits import limit_threads


@pytest.fixture(scope="module")
def benchmark(load_benchmark: Callable[[str], ModuleType]) -> Any:
    return load_benchmark("sigma")


@pytest.fixture(scope="module")
def draws(benchmark: Any) -> dict[str, Any]:
    limit_threads(1)
    bench = benchmark.Bench()
    return {case.name: bench.draws(case) for case in benchmark.CASES}


def test_three_noise_levels_at_two_exposures_are_among_the_cases(benchmark: Any) -> None:
    pressed = [c for c in benchmark.CASES if c.press_mm == 0.2 and not c.two_pictures]
    assert len({c.read_grey for c in pressed}) == 3
    assert len({(c.read_grey, c.exposure) for c in pressed}) == 6


@pytest.mark.parametrize("word", ["residual", "warp", "slope", "depth"])
def test_sigma_is_true(benchmark: Any, draws: dict[str, Any], word: str) -> None:
    for case in benchmark.CASES:
        ratio = draws[case.name].ratios(word)
        # 400 draws know a node's deviation to 3.5 %; 99 % of exact ones lie within 9 %
        assert 0.95 < np.median(ratio) < 1.05, case.name
        assert np.mean((ratio > 0.8) & (ratio < 1.2)) >= 0.99, case.name


def test_usable_nodes_are_called_valid(benchmark: Any, draws: dict[str, Any]) -> None:
    for case in benchmark.CASES:
        assert draws[case.name].valid_share >= 0.95, case.name


def test_noise_grows_as_light_gets_less(draws: dict[str, Any]) -> None:
    """A quarter of the light: 4 times the noise where reading dominates, 2 where photons do."""
    for level in ("low", "packaged", "high"):
        bright, dim = (
            np.nanmedian(draws[f"{level} noise, exposure {e}"].sigmas["depth"]) for e in ("1", "0.25")
        )
        assert 2.0 < dim / bright < 4.2


@pytest.mark.parametrize("name", ["packaged noise, exposure 1", "high noise, exposure 1"])
def test_covariance_is_true(draws: dict[str, Any], name: str) -> None:
    """Differences of depth between 40 pairs of nodes, near and far, and means over patches."""
    drawn = draws[name]
    depth = drawn.values["depth"][..., 0]
    whole = np.isfinite(depth).all(axis=0)
    depth = depth - np.nanmean(depth, axis=0)
    generator = np.random.default_rng(0)
    nodes = generator.permutation(np.argwhere(whole & drawn.usable))
    padded = np.array(whole.shape) + 8
    ratios = []
    for a, b in zip(nodes[:40], nodes[40:80], strict=True):
        weights = np.zeros(padded)
        weights[tuple(a + 4)], weights[tuple(b + 4)] = 1.0, -1.0
        stated = np.sqrt(drawn.covariance.variance_of(weights).noise)
        ratios.append(stated / (depth[:, *a] - depth[:, *b]).std())
    for a in nodes[80:100]:
        patch = np.zeros(whole.shape, bool)
        patch[max(a[0] - 3, 0) : a[0] + 4, max(a[1] - 3, 0) : a[1] + 4] = True
        patch &= whole
        weights = np.zeros(padded)
        weights[4:-4, 4:-4][patch] = 1.0 / np.count_nonzero(patch)
        stated = np.sqrt(drawn.covariance.variance_of(weights).noise)
        ratios.append(stated / depth[:, patch].mean(axis=1).std())
    # each known to 3.5 %
    assert 0.95 < np.median(ratios) < 1.05
    assert np.min(ratios) > 0.85
    assert np.max(ratios) < 1.15
