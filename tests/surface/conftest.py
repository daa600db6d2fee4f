"""Benches of the surface tests, each with a reader of its own per file."""

import pytest
from surface_bench import Bench, small_rig

from zeromethod import binned, load_rig


@pytest.fixture(scope="module")
def small():
    """The packaged bench binned by 4."""
    return Bench(small_rig())


@pytest.fixture(scope="module")
def finer():
    """The packaged bench binned by 2."""
    return Bench(binned(load_rig("simulated"), 2))


@pytest.fixture(scope="module")
def full():
    """The packaged bench."""
    return Bench(load_rig("simulated"))
