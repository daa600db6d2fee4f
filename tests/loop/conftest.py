import threading
from collections.abc import Iterator

import pytest
from live_bench import Bench, bench


@pytest.fixture
def hung() -> Iterator[threading.Event]:
    """What hangs waits for this, which is set at the end."""
    event = threading.Event()
    yield event
    event.set()


@pytest.fixture(params=[False, True], ids=["simulated", "real"])
def either(request: pytest.FixtureRequest) -> Iterator[Bench]:
    """A bench in simulated time, then one in the host's."""
    with bench(request.param) as made:
        yield made


@pytest.fixture
def simulated() -> Iterator[Bench]:
    with bench(real=False) as made:
        yield made


@pytest.fixture
def real() -> Iterator[Bench]:
    with bench(real=True) as made:
        yield made
