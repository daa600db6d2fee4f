"""Shader files: includes, defines, and errors that name file and line."""

from pathlib import Path

import pytest

from zeromethod.gl import program, shader
from zeromethod.gl.shader import shader_source

VERTEX = """out float value;
void main() { value = float(gl_VertexID) * SCALE; gl_Position = vec4(0.0); }
"""


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Folder of shaders in place of the packaged one."""
    monkeypatch.setattr(shader, "resource", lambda _, name: tmp_path / name)
    return tmp_path


def write(folder: Path, **files: str) -> None:
    """Files by name ("main_frag" is main.frag), with #version before each stage's text."""
    for name, text in files.items():
        version = "" if name.endswith("glsl") else "#version 330\n"
        (folder / name.replace("_", ".")).write_text(version + text)


def test_includes_stand_in_place_and_only_once(folder):
    main = '#include "a.glsl"\n  #include "b.glsl"  \nmain\n'
    write(folder, main_frag=main, a_glsl='#include "b.glsl"\na\n', b_glsl="b\n")
    assert shader_source("main.frag") == "#version 330\nb\na\nmain\n"


def test_defines_follow_the_version(folder):
    write(folder, main_frag="main\n")
    source = shader_source("main.frag", N=3, SCALE=2.0, SMALL=1e-7, ON=True, KIND="vec2")
    defined = ["N 3", "SCALE 2.0", "SMALL 1e-07", "ON 1", "KIND vec2"]
    assert source.splitlines()[1:-1] == [f"#define {each}" for each in defined]


@pytest.mark.parametrize(
    ("files", "message"),
    [
        ({}, r"^shader: shader 'main\.frag' cannot be read \(No such file or directory\)$"),
        ({"main_frag": '\n#include "no.glsl"\n'}, r"^main\.frag:3: shader 'no\.glsl' cannot be read"),
        (
            {"main_frag": '#include "a.glsl"\n', "a_glsl": '\n#include "a.glsl"\n'},
            r"^a\.glsl:2: #include 'a\.glsl' goes round in a circle$",
        ),
        (
            {
                "main_frag": '#include "a.glsl"\n',
                "a_glsl": '#include "b.glsl"\n',
                "b_glsl": '#include "a.glsl"\n',
            },
            r"^b\.glsl:1: #include 'a\.glsl' goes round in a circle$",
        ),
    ],
)
def test_bad_includes_name_their_place(folder, files, message):
    write(folder, **files)
    with pytest.raises(RuntimeError, match=message):
        shader_source("main.frag")


@pytest.mark.parametrize("text", ["void main() {}\n", ""])
def test_a_shader_without_its_version_is_refused(folder, text):
    (folder / "main.frag").write_text(text)
    with pytest.raises(RuntimeError, match=r"^main\.frag:1: a shader starts with #version$"):
        shader_source("main.frag")


INCLUDING = '#include "a.glsl"\nout float f;\nvoid main() { f = 1.0; }\n'


@pytest.mark.parametrize(
    ("files", "place"),
    [
        ({"main_frag": "out float f;\nvoid main() {\n  f = oops;\n}\n"}, r"main\.frag:4: .*oops"),
        ({"main_frag": INCLUDING, "a_glsl": "float g() {\n  return wrong;\n}\n"}, r"a\.glsl:2: .*wrong"),
        ({"main_frag": "out float f;\nvoid main() { f = SCALE + bad; }\n"}, r"main\.frag:3: .*bad"),
        # the vertex stage's are not blamed on the other
        ({"main_vert": "\nvoid main() { no; }\n", "main_frag": "void main() {}\n"}, r"main\.vert:3: .*no"),
    ],
)
def test_compile_errors_name_file_and_line(gl_context, folder, files, place):
    write(folder, **{"main_vert": VERTEX} | files)
    with pytest.raises(RuntimeError, match=place) as caught:
        program(gl_context, "main.vert", "main.frag", SCALE=1.0)
    assert "\n" not in str(caught.value)


def test_link_errors_name_the_files(gl_context, folder):
    write(
        folder,
        main_vert="out vec2 a;\nvoid main() { a = vec2(1.0); gl_Position = vec4(0.0); }\n",
        main_frag="in float a;\nout float f;\nvoid main() { f = a; }\n",
    )
    with pytest.raises(RuntimeError, match=r"^main\.vert, main\.frag: .*type"):
        program(gl_context, "main.vert", "main.frag")
