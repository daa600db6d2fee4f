"""A GL context of EGL without a surface: on a GPU where there is one, else on Mesa's llvmpipe."""

from __future__ import annotations

from typing import Any

import glcontext

_OPENGL = 330
_MAX_DEVICES = 8


def _open(device: int) -> Any:
    create = glcontext.get_backend_by_name("egl")
    return create(
        mode="standalone",
        libgl="libGL.so.1",
        libegl="libEGL.so.1",
        glversion=_OPENGL,
        device_index=device,
    )


class EGLContext:
    """Core-profile context (3.3 or newer) of the first EGL device that gives one.

    Raises RuntimeError with the first device's reason when none does (a GPU may be there but closed to
    this user, with llvmpipe listed after it). `GLCONTEXT_DEVICE_INDEX` picks one device.
    """

    def __init__(self) -> None:
        reason = ""
        for device in range(_MAX_DEVICES):
            try:
                self._binding = _open(device)
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
