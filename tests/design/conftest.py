"""The view of the telecentric bench, made once."""

import pytest

from zeromethod.design import SampledView

from .design_benches import telecentric


@pytest.fixture(scope="session")
def view() -> SampledView:
    """Parallel rays at right angles to both faces of a prism of 50 degrees."""
    return SampledView(telecentric())
