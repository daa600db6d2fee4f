"""Context handles: `with ctx:` that nests, whatever library each context comes from.

The EGL binding of moderngl leaves nothing current when a `with` block ends, and EGL and OSMesa do not
know of each other. A handle keeps track per thread: it unbinds the context before in that one's own
library, binds its own, and puts the old state back at the end.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Protocol


class NativeContext(Protocol):
    """A context of one library. `bind` and `unbind` act on the calling thread."""

    def bind(self) -> None:
        """Make it current."""

    def unbind(self) -> None:
        """Make nothing of this library current."""

    def address(self, name: str) -> int:
        """Address of a GL function, 0 when there is none."""

    def destroy(self) -> None:
        """Free it; it is not current."""


_thread = threading.local()


def _current() -> ContextHandle | None:
    return getattr(_thread, "current", None)


def _switch(to: ContextHandle | None) -> None:
    """Make a handle's context current, or none."""
    before = _current()
    if before is not None and before is not to and before.native is not None:
        before.native.unbind()
    _thread.current = None
    if to is not None and to.native is not None:
        # Also when it is recorded as current: a window library may have made its own one current.
        to.native.bind()
        _thread.current = to


@contextmanager
def current_context_kept() -> Iterator[None]:
    """Make the context that is current now, or none, current again at the end."""
    before = _current()
    try:
        yield
    finally:
        _switch(before)


class ContextHandle:
    """A native context with the members that `moderngl.create_context(context=...)` asks for.

    `create` makes the native context. It is current in the creating thread from creation on.
    """

    def __init__(self, create: Callable[[], NativeContext]) -> None:
        self._before: list[ContextHandle | None] = []
        before = _current()
        # EGL binds what it creates and later skips a bind that it considers done, so OSMesa must be unbound
        # before.
        _switch(None)
        try:
            self.native: NativeContext | None = create()
        except Exception:
            _switch(before)
            raise
        _switch(self)

    def load_opengl_function(self, name: str) -> int:
        """Address of a GL function, 0 when there is none."""
        return self.native.address(name) if self.native is not None else 0

    load = load_opengl_function

    def __enter__(self) -> ContextHandle:
        if self.native is None:
            raise RuntimeError("the OpenGL context has been released")
        self._before.append(_current())
        _switch(self)
        return self

    def __exit__(self, *exception: object) -> None:
        _switch(self._before.pop())

    def release(self) -> None:
        """Destroy the context with all that it owns; safe to call twice."""
        if self.native is None:
            return
        if _current() is self:
            _switch(None)
        native, self.native = self.native, None
        native.destroy()
