from __future__ import annotations

import threading
from collections.abc import Iterator

import pytest


@pytest.fixture
def hung() -> Iterator[threading.Event]:
    """What hangs waits for this, which is set at the end."""
    event = threading.Event()
    yield event
    event.set()
