"""GLSL programs from the packaged shader files: includes, defines, and errors that name file and line."""

from __future__ import annotations

import re
from dataclasses import dataclass

import moderngl

from zeromethod.resources import resource

Define = int | float | str
"""Value of a `#define`: numbers are written so that GLSL reads the same type, text as it is."""

_INCLUDE = re.compile(r'^\s*#include\s+"([^"]+)"\s*$')
_LOG_LINE = re.compile(r"^(?:ERROR:\s*)?0[:(](\d+)(?:\(\d+\)|\))?\s*:?\s*(.*)$")
_STAGES = ("vertex_shader", "fragment_shader")


@dataclass(frozen=True, slots=True)
class _Line:
    text: str
    file: str
    number: int


def _read(name: str, asked_by: str) -> list[_Line]:
    try:
        text = resource("shaders", name).read_text(encoding="utf-8")
    except OSError as error:
        raise RuntimeError(f"{asked_by}: shader {name!r} cannot be read ({error.strerror})") from error
    return [_Line(line, name, number) for number, line in enumerate(text.splitlines(), start=1)]


def _flatten(name: str, asked_by: str, open_files: tuple[str, ...], included_before: set[str]) -> list[_Line]:
    """Lines of a file with its includes put in; a file that was put in before is left out."""
    included_before.add(name)
    lines = []
    for line in _read(name, asked_by):
        match = _INCLUDE.match(line.text)
        if not match:
            lines.append(line)
            continue
        included, place = match.group(1), f"{line.file}:{line.number}"
        if included in (*open_files, name):
            raise RuntimeError(f"{place}: #include {included!r} goes round in a circle")
        if included not in included_before:
            lines += _flatten(included, place, (*open_files, name), included_before)
    return lines


def _define(name: str, value: Define) -> str:
    # bool is an int whose repr GLSL would not read as a number
    return f"#define {name} {int(value) if isinstance(value, bool) else value}"


def _lines(name: str, defines: dict[str, Define]) -> list[_Line]:
    lines = _flatten(name, "shader", (), set())
    if not lines or not lines[0].text.startswith("#version"):
        raise RuntimeError(f"{name}:1: a shader starts with #version")
    given = [_Line(_define(key, value), f"{name} (define {key})", 1) for key, value in defines.items()]
    return [lines[0], *given, *lines[1:]]


def shader_source(name: str, **defines: Define) -> str:
    """GLSL of the packaged shader `name`, e.g. "mirror.frag": includes resolved, defines after #version.

    `#include "x.glsl"` on a line of its own puts that file of the shader folder in its place, once per
    program stage. Raises RuntimeError (file and line) for a missing file or a circle of includes.
    """
    return "\n".join(line.text for line in _lines(name, defines)) + "\n"


def _readable(log: str, stages: dict[str, list[_Line]]) -> str:
    """First complaint of the compiler as "file:line: message", else its whole log on one line."""
    lines: list[_Line] = []
    for text in log.splitlines():
        stripped = text.strip()
        if stripped in _STAGES:
            lines = stages.get(stripped, [])
        match = _LOG_LINE.match(stripped)
        if match and 1 <= int(match.group(1)) <= len(lines):
            line = lines[int(match.group(1)) - 1]
            return f"{line.file}:{line.number}: {match.group(2).strip()}"
    names = ", ".join(dict.fromkeys(stage[0].file for stage in stages.values()))
    return f"{names}: {' '.join(log.split())}"


def program(
    ctx: moderngl.Context,
    vertex: str,
    fragment: str,
    **defines: Define,
) -> moderngl.Program:
    """Program from packaged shader files, e.g. `program(ctx, "mesh.vert", "pattern.frag", PERIOD=16)`.

    `defines` go to both stages. Raises RuntimeError that names file and line of the first error.
    """
    stages = {"vertex_shader": _lines(vertex, defines), "fragment_shader": _lines(fragment, defines)}
    sources = {stage: "\n".join(line.text for line in lines) + "\n" for stage, lines in stages.items()}
    try:
        return ctx.program(vertex_shader=sources["vertex_shader"], fragment_shader=sources["fragment_shader"])
    except moderngl.Error as error:
        raise RuntimeError(_readable(str(error), stages)) from error
