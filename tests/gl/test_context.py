"""Contexts of both backends: they draw, live side by side, nest, and fail in one line."""

from collections.abc import Callable, Iterator

import moderngl
import numpy as np
import pytest

from zeromethod.errors import InputError
from zeromethod.gl import collect, context, create_context, osmesa
from zeromethod.gl.context import BACKENDS, VARIABLE

Create = Callable[[str], moderngl.Context]
GREEN, RED = (0.0, 1.0, 0.0, 1.0), (1.0, 0.0, 0.0, 1.0)


def cleared(ctx: moderngl.Context, colour: tuple[float, float, float, float]) -> list[int]:
    """First pixel of a framebuffer of this context after clearing it, 0..255."""
    framebuffer = ctx.simple_framebuffer((8, 8), 4)
    framebuffer.clear(*colour)
    pixel = list(framebuffer.read(components=4)[:4])
    framebuffer.release()
    return pixel


@pytest.fixture
def create(monkeypatch: pytest.MonkeyPatch) -> Iterator[Create]:
    """Makes a context of a backend; all are released in the end."""
    made = []

    def context_of(backend: str) -> moderngl.Context:
        monkeypatch.setenv(VARIABLE, backend)
        made.append(create_context())
        return made[-1]

    yield context_of
    for ctx in made:
        ctx.release()


def test_context_is_core_3_3_or_newer(gl_context):
    assert gl_context.version_code >= 330


@pytest.mark.parametrize(("forced", "opened"), [("", "egl"), ("egl", "egl"), ("osmesa", "osmesa")])
def test_the_variable_chooses_and_without_it_egl_comes_first(create, monkeypatch, forced, opened):
    (other,) = {*BACKENDS} - {opened}
    monkeypatch.setitem(context.BACKENDS, other, lambda: pytest.fail("the other one was tried"))
    create(forced)


def test_new_context_is_current_many_can_be_made_and_released_twice(create, gl_backend):
    for _ in range(25):
        ctx = create(gl_backend)
        assert cleared(ctx, GREEN) == [0, 255, 0, 255]
        ctx.release()


def test_making_a_context_inside_a_block_does_not_steal_it(create, gl_context, gl_backend):
    other = create(gl_backend)
    with gl_context:
        assert cleared(gl_context, RED) == [255, 0, 0, 255]
    assert cleared(other, GREEN) == [0, 255, 0, 255]
    with gl_context:
        assert cleared(gl_context, RED) == [255, 0, 0, 255]


@pytest.mark.parametrize("outer", BACKENDS)
@pytest.mark.parametrize("inner", BACKENDS)
def test_blocks_nest_across_contexts_and_backends(create, outer, inner):
    first, second = create(outer), create(inner)
    for _ in range(3):
        with first:
            with second:
                assert cleared(second, GREEN) == [0, 255, 0, 255]
                with first, first:
                    assert cleared(first, RED) == [255, 0, 0, 255]
                assert cleared(second, RED) == [255, 0, 0, 255]
            assert cleared(first, GREEN) == [0, 255, 0, 255]
    assert (first.error, second.error) == ("GL_NO_ERROR", "GL_NO_ERROR")


def test_what_one_context_holds_is_untouched_by_the_other(create):
    contexts = [create(backend) for backend in (*BACKENDS, *BACKENDS)]
    framebuffers = []
    for level, ctx in enumerate(contexts):
        with ctx:
            framebuffers.append(ctx.simple_framebuffer((4, 4), 1, dtype="f4"))
            framebuffers[-1].clear(red=float(level))
    for level, (ctx, framebuffer) in enumerate(zip(contexts, framebuffers, strict=True)):
        with ctx:
            values = np.frombuffer(framebuffer.read(components=1, dtype="f4"), np.float32)
        assert values.tolist() == [float(level)] * 16


def test_forgotten_objects_wait_to_be_collected(gl_context):
    collect(gl_context)
    kept, released = gl_context.buffer(reserve=16), gl_context.buffer(reserve=16)
    gl_context.buffer(reserve=16)
    released.release()
    del released
    assert collect(gl_context) == 1
    assert kept.size == 16


@pytest.mark.parametrize("value", ["cuda", "EGL", "egl,osmesa"])
def test_unknown_backend_is_refused(create, value):
    with pytest.raises(InputError, match=f"^ZEROMETHOD_GL: '{value}': allowed are egl, osmesa$"):
        create(value)


@pytest.fixture
def nothing_installed(monkeypatch: pytest.MonkeyPatch) -> None:
    def no_egl(device: int) -> None:
        raise Exception("libEGL.so.1 not loaded")

    def no_osmesa() -> None:
        raise osmesa.OSMesaError("libOSMesa.so.8: cannot open shared object file")

    monkeypatch.setattr(context, "_open_egl", no_egl)
    monkeypatch.setattr(osmesa, "load_osmesa", no_osmesa)


@pytest.mark.usefixtures("nothing_installed")
def test_when_nothing_works_one_line_names_reasons_and_packages(monkeypatch):
    monkeypatch.delenv(VARIABLE, raising=False)
    with pytest.raises(InputError) as caught:
        create_context()
    assert str(caught.value) == (
        "OpenGL: no context without a screen (egl: libEGL.so.1 not loaded; "
        "osmesa: libOSMesa.so.8: cannot open shared object file): "
        "install libegl1 libgl1 libgl1-mesa-dri libglx-mesa0 / libosmesa6"
    )


@pytest.mark.usefixtures("nothing_installed")
def test_forcing_a_backend_that_fails_does_not_fall_back_and_leaves_the_current_context_current(
    create, gl_context, gl_backend
):
    with pytest.raises(InputError, match=f"\\({gl_backend}: [^)]*\\): install "):
        create(gl_backend)
    assert cleared(gl_context, GREEN) == [0, 255, 0, 255]


def test_egl_devices_that_are_closed_to_the_user_are_skipped(create, monkeypatch):
    real = context._open_egl

    def gpu_first(device: int) -> object:
        if device == 0:
            raise Exception("eglInitialize failed (0x3001)")
        return real(device - 1)

    monkeypatch.setattr(context, "_open_egl", gpu_first)
    assert cleared(create("egl"), GREEN) == [0, 255, 0, 255]


def test_without_a_system_library_the_wheel_is_named(monkeypatch):
    def not_installed(name: str) -> None:
        raise osmesa.metadata.PackageNotFoundError(name)

    monkeypatch.setattr(osmesa, "_SYSTEM_NAMES", ("libnowhere.so",))
    monkeypatch.setattr(osmesa.metadata, "distribution", not_installed)
    load_afresh = osmesa.load_osmesa.__wrapped__
    with pytest.raises(
        osmesa.OSMesaError, match=r"libnowhere\.so: .*; wheel lavavu-osmesa is not installed$"
    ):
        load_afresh()
