"""GL contexts without a screen: EGL where there is one, else OSMesa inside the process.

Convention: GL commands go to the context that is *current* in the calling thread. A new context is
current at once; it can be current in one thread at a time. Where a process has more than one, every
piece of code enters the one it draws with (`with ctx:`); objects are created, used and released inside.
The blocks nest, also across backends, and the context that was current before is current again at the
end.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from typing import Any

import glcontext
import moderngl

from zeromethod.errors import InputError
from zeromethod.gl.handle import ContextHandle, NativeContext
from zeromethod.gl.osmesa import OSMesaContext

VARIABLE = "ZEROMETHOD_GL"
"""Environment variable that forces a backend."""

_PACKAGES = {"egl": "libegl1 libgl1 libgl1-mesa-dri libglx-mesa0", "osmesa": "libosmesa6"}
_OPENGL = 330
_MAX_DEVICES = 8


def _open_egl(device: int) -> Any:
    create = glcontext.get_backend_by_name("egl")
    libraries = {"libgl": "libGL.so.1", "libegl": "libEGL.so.1"}
    return create(mode="standalone", glversion=_OPENGL, device_index=device, **libraries)


class EGLContext:
    """Core-profile context (3.3 or newer) of the first EGL device that gives one.

    Raises RuntimeError with the first device's reason when none does (a GPU may be there but closed to
    this user, with llvmpipe listed after it). `GLCONTEXT_DEVICE_INDEX` picks one device.
    """

    def __init__(self) -> None:
        reason = ""
        for device in range(_MAX_DEVICES):
            try:
                self._binding = _open_egl(device)
            except Exception as error:  # the binding raises bare Exception
                reason = reason or str(error)
                if "device index" in str(error) or "not loaded" in str(error):
                    break
            else:
                return
        raise RuntimeError(reason)

    def bind(self) -> None:
        """Make it current in this thread."""
        self._binding.__enter__()

    def unbind(self) -> None:
        """Make no EGL context current in this thread."""
        self._binding.__exit__(None, None, None)

    def address(self, name: str) -> int:
        """Address of a GL function, 0 when there is none."""
        return int(self._binding.load_opengl_function(name) or 0)

    def destroy(self) -> None:
        """Free the context; it is not current."""
        self._binding.release()


BACKENDS: dict[str, Callable[[], NativeContext]] = {"egl": EGLContext, "osmesa": OSMesaContext}
"""In the order in which they are tried."""


def create_context() -> moderngl.Context:
    """Create a standalone OpenGL context, core profile 3.3 or newer, current in this thread.

    EGL, then OSMesa; the environment variable `ZEROMETHOD_GL` (egl or osmesa) forces one. Objects that
    Python forgets are freed by `collect` or with the context by `ctx.release()`, never behind the back of
    whatever context is current then.

    Raises
    ------
    InputError
        The variable has another value, or no backend works (with the reasons and the packages).
    """
    forced = os.environ.get(VARIABLE, "")
    if forced and forced not in BACKENDS:
        raise InputError(f"{VARIABLE}: {forced!r}: allowed are {', '.join(BACKENDS)}")
    tried = (forced,) if forced else tuple(BACKENDS)
    reasons = []
    for backend in tried:
        try:
            handle: Any = ContextHandle(BACKENDS[backend])
            context = moderngl.create_context(require=_OPENGL, standalone=True, context=handle)
        except (RuntimeError, ValueError) as error:
            reasons.append(f"{backend}: {' '.join(str(error).split())}")
            continue
        context.gc_mode = "context_gc"
        return context
    packages = " / ".join(_PACKAGES[backend] for backend in tried)
    raise InputError(f"OpenGL: no context without a screen ({'; '.join(reasons)}): install {packages}")


def collect(ctx: moderngl.Context) -> int:
    """Free the textures, buffers and programs that Python has forgotten; return how many.

    In place of `ctx.gc()`, which fails on an object that was released by hand before it was forgotten.
    """
    freed = 0
    with ctx:
        while ctx.objects:
            release = getattr(ctx.objects.popleft(), "release", None)
            if release is not None:
                release()
                freed += 1
    return freed
