"""What shaders write is what is read back, bit for bit, on both backends."""

from pathlib import Path

import moderngl
import numpy as np
import pytest

from zeromethod.gl import program, shader

SIZE = (37, 23)
"""(columns, rows): odd, so that a wrong row stride shows."""

FILL = """#version 330
const vec2 corner[3] = vec2[3](vec2(-1.0, -1.0), vec2(3.0, -1.0), vec2(-1.0, 3.0));
void main() { gl_Position = vec4(corner[gl_VertexID], 0.0, 1.0); }
"""

PATTERN = """#version 330
out vec4 light;
void main() {
    ivec2 p = ivec2(gl_FragCoord.xy);
    light = vec4(float((7 * p.x + 13 * p.y) % 256) / 255.0, float(p.x) / 255.0, float(p.y) / 255.0, 1.0);
}
"""

FLOATS = """#version 330
out vec4 value;
void main() {
    vec2 p = gl_FragCoord.xy - 0.5;
    value = vec4(1e-3 * p.x + 1e-9, -1234.5678 * p.y, p.x * p.y / 3.0, 1.0 / (1.0 + p.x));
}
"""

FETCH = """#version 330
uniform sampler2D source;
out vec4 value;
void main() {
    ivec2 size = textureSize(source, 0);
    value = texelFetch(source, size - 1 - ivec2(gl_FragCoord.xy), 0);
}
"""


@pytest.fixture(autouse=True)
def shaders(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Folder of shaders in place of the packaged one."""
    monkeypatch.setattr(shader, "resource", lambda _, name: tmp_path / name)
    texts = {"fill.vert": FILL, "pattern.frag": PATTERN, "floats.frag": FLOATS, "fetch.frag": FETCH}
    for name, text in texts.items():
        (tmp_path / name).write_text(text)


def draw(ctx: moderngl.Context, fragment: str, target: moderngl.Texture, **uniforms: int) -> None:
    """Fill a texture with a fragment shader."""
    drawn = program(ctx, "fill.vert", fragment)
    for name, value in uniforms.items():
        drawn[name] = value
    framebuffer = ctx.framebuffer([target])
    framebuffer.use()
    ctx.vertex_array(drawn, []).render(vertices=3)


def texels(texture: moderngl.Texture) -> np.ndarray:
    """(rows, cols, components) of a texture; row 0 is GL's lowest, y = 0."""
    kind = np.float32 if texture.dtype == "f4" else np.uint8
    return np.frombuffer(texture.read(alignment=1), kind).reshape(texture.height, texture.width, -1)


def test_eight_bit_pattern_comes_back_bit_exact(gl_context):
    target = gl_context.texture(SIZE, 4, dtype="f1")
    draw(gl_context, "pattern.frag", target)
    y, x = np.mgrid[: SIZE[1], : SIZE[0]]
    expected = np.stack([(7 * x + 13 * y) % 256, x, y, np.full_like(x, 255)], axis=-1)
    assert np.array_equal(texels(target), expected)


@pytest.mark.parametrize("components", [1, 2, 4])
def test_float_textures_are_render_targets_of_full_precision(gl_context, components):
    target = gl_context.texture(SIZE, components, dtype="f4")
    draw(gl_context, "floats.frag", target)
    y, x = np.mgrid[: SIZE[1], : SIZE[0]].astype(np.float64)
    exact = np.stack([1e-3 * x + 1e-9, -1234.5678 * y, x * y / 3.0, 1.0 / (1.0 + x)], axis=-1)
    # float32 rounding of two or three operations; division on llvmpipe is good to 2.5 ulp (GLSL's bound)
    np.testing.assert_allclose(texels(target), exact[..., :components], rtol=4e-7)


@pytest.mark.parametrize("components", [1, 2, 4])
def test_texel_fetch_returns_what_was_uploaded_bit_exact(gl_context, components):
    rng = np.random.default_rng(1)
    values = rng.normal(scale=1e3, size=(*SIZE[::-1], components)).astype(np.float32)
    source = gl_context.texture(SIZE, components, values.tobytes(), dtype="f4", alignment=1)
    target = gl_context.texture(SIZE, components, dtype="f4")
    source.use(location=2)
    draw(gl_context, "fetch.frag", target, source=2)
    assert np.array_equal(texels(target), values[::-1, ::-1])


def test_a_texture_just_drawn_can_be_fetched_by_the_next_pass(gl_context):
    first, second = (gl_context.texture(SIZE, 4, dtype="f4") for _ in range(2))
    draw(gl_context, "floats.frag", first)
    first.use(location=0)
    draw(gl_context, "fetch.frag", second, source=0)
    assert np.array_equal(texels(second), texels(first)[::-1, ::-1])
