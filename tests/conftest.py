"""Fixtures of all tests: an OpenGL context of every backend.

Contexts of both backends live side by side for the whole session; a test that draws runs with its own
one entered, so objects always go to the context they belong to.
"""

import math
import os
import sys
from collections.abc import Iterator
from typing import Any

if os.environ.pop("PYTHONDONTWRITEBYTECODE", None):
    # each of a hundred processes would compile all sources again, each worker the tests' own assertions
    sys.dont_write_bytecode = False

if "PYTEST_XDIST_WORKER" in os.environ:
    # Workers share the cores out already: threads of libraries would only wait for each other. These are read
    # when a library is loaded.
    os.environ |= {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", "LP_NUM_THREADS": "0"}

import moderngl
import pytest
from xdist.scheduler import LoadScopeScheduling

from zeromethod.compiling import all_modules, compile_ahead
from zeromethod.gl import collect, create_context
from zeromethod.gl.context import BACKENDS, VARIABLE
from zeromethod.view import progress

REAL_TIME = (
    "loop/test_live_",
    "drivers/",
    "publishing/",
    "page/",
    "recording/test_recorder",
    "view/test_follow",
    "session/test_live_",
    "simulation/test_virtual_bench",
    "cli/test_stopping",
    "cli/test_keys",
    "cli/test_devices",
    "acceptance/test_live_",
    "acceptance/test_emulated_",
)
"""Tests in which time passes for real, or that need a device of this machine to themselves."""

SHARING = ("calibration/", "export/", "commissioning/calibration/", "session/replay/", "view/")
"""Folders whose tests share fixtures that take seconds."""

ORDER = ("tests/drivers/", "tests/acceptance/", "tests/test_", "tests/study/", "tests/view/", "tests/c")
"""What begins: drivers, then tests of many seconds each, so that at the end no worker waits for one that
began them last."""


class _Together(LoadScopeScheduling):
    """Tests of a file go to one worker, and so do those that share more: it is made only once."""

    def _split_scope(self, nodeid: str) -> str:
        file = nodeid.partition("::")[0]
        place = file.removeprefix("tests/")
        if place.startswith(REAL_TIME):
            return "real time"
        return next((folder for folder in SHARING if place.startswith(folder)), file)


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_setup(item: pytest.Item) -> None:
    """A worker that only computes makes way for the one whose tests are in real time, from its first test on.

    That one waits half of its time, so that there is one worker more than there are cores.
    """
    real_time = item.nodeid.removeprefix("tests/").startswith(REAL_TIME)
    if "PYTEST_XDIST_WORKER" in os.environ and not real_time and not os.getpriority(os.PRIO_PROCESS, 0):
        os.nice(5)


def pytest_configure(config: pytest.Config) -> None:
    """Compile what is not compiled yet once, on every core, before workers start that would do it each."""
    if "PYTEST_XDIST_WORKER" not in os.environ and config.getoption("numprocesses", None):
        compile_ahead(all_modules(), lambda words: sys.stderr.writelines((words, "\n")))


def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> _Together:
    """Of several workers, one runs all tests in real time, one after the other."""
    config.option.loadscopereorder = False  # few tests in a file does not mean that they are short
    return _Together(config, log)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """In `ORDER`, then the others as they come."""
    items.sort(key=lambda item: [not item.nodeid.startswith(first) for first in ORDER])


@pytest.fixture(autouse=True)
def _no_lines_of_progress(monkeypatch: pytest.MonkeyPatch) -> None:
    """On a busy machine any command may last so long that it says how far it is."""
    monkeypatch.setattr(progress, "EVERY_S", math.inf)


@pytest.fixture(params=BACKENDS, scope="session")
def gl_backend(request: pytest.FixtureRequest) -> str:
    """Name of the backend: "egl", then "osmesa"."""
    return str(request.param)


@pytest.fixture(scope="session")
def _session_context(gl_backend: str) -> Iterator[moderngl.Context]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv(VARIABLE, gl_backend)
        ctx = create_context()
    yield ctx
    ctx.release()


@pytest.fixture
def gl_context(_session_context: moderngl.Context) -> Iterator[moderngl.Context]:
    """Context of the backend, current during the test; what the test made is freed after it."""
    with _session_context as ctx:
        yield ctx
        collect(ctx)
