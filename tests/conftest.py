"""Fixtures of all tests: an OpenGL context of every backend.

Contexts of both backends live side by side for the whole session; a test that draws runs with its own
one entered, so objects always go to the context they belong to.
"""

from __future__ import annotations

from collections.abc import Iterator

import moderngl
import pytest

from zeromethod.gl import collect, create_context
from zeromethod.gl.context import BACKENDS, VARIABLE


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
