"""A machine on which no further process can be started."""

import errno
import os
from typing import Any

import pytest

from zeromethod.session import surfaces as process


@pytest.fixture
def no_process(monkeypatch: pytest.MonkeyPatch) -> None:
    """None can be started; where it does not matter, none need be: it takes seconds."""

    def refuse(*_arguments: object, **_streams: object) -> Any:
        raise BlockingIOError(errno.EAGAIN, os.strerror(errno.EAGAIN))

    monkeypatch.setattr(process, "start_process", refuse)
