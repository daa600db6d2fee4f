"""Fixtures of all tests: an OpenGL context of every backend.

Contexts of both backends live side by side for the whole session; a test that draws runs with its own
one entered, so objects always go to the context they belong to.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import moderngl
import pytest

from zeromethod.gl import collect, create_context
from zeromethod.gl.context import BACKENDS, VARIABLE

REAL_TIME = (
    "control/test_live_",
    "drivers/",
    "publishing/",
    "recording/test_recorder",
    "view/test_follow",
    "procedures/test_live_",
    "procedures/test_virtual_bench",
    "cli/test_stopping",
    "cli/test_keys",
    "cli/test_devices",
    "acceptance/test_live_",
    "acceptance/test_emulated_",
)
"""Tests in which time passes for real, or that need a device of this machine to themselves."""


SHARING = ("calibration/", "export/", "procedures/calibration/", "procedures/replay/", "view/")
"""Folders whose tests share fixtures that take seconds."""


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Tests that share something are run by one of several workers, so that it is made only once."""
    for item in items:
        place = item.path.relative_to(Path(__file__).parent).as_posix()
        group = next((folder for folder in SHARING if place.startswith(folder)), place)
        if place.startswith(REAL_TIME):
            group = "real time"
        item.add_marker(pytest.mark.xdist_group(group))


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
