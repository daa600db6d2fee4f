"""Size of the code by room, and whether it stays below ceilings: python tools/size.py [--check | --write].

Printed, so that neither short names nor dense lines gain anything: tokens of the language, without comments,
docstrings and line ends; fixed numbers of modules and classes, each of a tuple counted (a sum or product of
others, too); compiled functions. --check: a line for each room above its ceiling in tools/ceilings.toml, exit
code 1. --write: ceilings of today's sizes, rounded up to 500 tokens; the reasons beside them stay.
"""

from __future__ import annotations

import ast
import io
import subprocess
import sys
import tokenize
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import tomlkit

ROOT = Path(__file__).parent.parent
CEILINGS = ROOT / "tools" / "ceilings.toml"
FOLDERS = ("zeromethod", "tests", "benchmarks", "tools", "examples")
ROUNDED_TO = 500

_UNCOUNTED = {
    *(tokenize.ENCODING, tokenize.COMMENT, tokenize.NL, tokenize.NEWLINE),
    *(tokenize.INDENT, tokenize.DEDENT, tokenize.ENDMARKER),
}
_COMPILES = ("jit", "vectorize", "kernel", "piece")


class Size(NamedTuple):
    """What is counted."""

    tokens: int = 0
    numbers: int = 0
    compiled: int = 0


def size_of(source: str) -> Size:
    """Size of a file's text."""
    nodes = list(ast.walk(ast.parse(source)))
    return Size(
        _tokens(source, nodes),
        sum(map(_is_number, _fixed(nodes))),
        sum(isinstance(node, ast.FunctionDef) and _is_compiled(node) for node in nodes),
    )


def _tokens(source: str, nodes: list[ast.AST]) -> int:
    """Tokens; a string that stands alone, under a definition or a constant, is a docstring."""
    alone = set()
    for node in nodes:
        body = getattr(node, "body", None)
        for one in body if isinstance(body, list) else []:
            match one:
                case ast.Expr(value=ast.Constant(value=str())):
                    alone.add((one.lineno, one.col_offset))
    found = tokenize.generate_tokens(io.StringIO(source).readline)
    counted = (one for one in found if one.type not in _UNCOUNTED)
    return sum(one.type != tokenize.STRING or one.start not in alone for one in counted)


def _fixed(nodes: list[ast.AST]) -> Iterator[ast.expr]:
    """Values assigned in modules and classes, those of a tuple one by one."""
    for node in nodes:
        for one in node.body if isinstance(node, (ast.Module, ast.ClassDef)) else []:
            if isinstance(one, (ast.Assign, ast.AnnAssign)) and one.value is not None:
                yield from one.value.elts if isinstance(one.value, ast.Tuple) else [one.value]


def _is_number(value: ast.expr) -> bool:
    try:
        known = ast.literal_eval(value)
    except (ValueError, TypeError):
        return isinstance(value, ast.BinOp)
    return isinstance(value, ast.BinOp) or type(known) in {int, float}


def _is_compiled(function: ast.FunctionDef) -> bool:
    return any(word in ast.dump(one) for one in function.decorator_list for word in _COMPILES)


def room_of(path: str) -> str:
    """Room of a file: each folder of the package is one, and so are its own modules; else the top folder."""
    top, *inside = path.split("/")
    if top != "zeromethod":
        return top
    return f"zeromethod/{inside[0]}" if len(inside) > 1 else "zeromethod/*.py"


def sizes() -> dict[str, Size]:
    """Size of every room, of the files that git knows."""
    listed = subprocess.run(
        ["git", "ls-files", *FOLDERS], cwd=ROOT, capture_output=True, text=True, check=True
    )
    rooms: dict[str, Counter[str]] = {}
    for path in (name for name in listed.stdout.splitlines() if name.endswith(".py")):
        size = size_of((ROOT / path).read_text(encoding="utf-8"))
        rooms.setdefault(room_of(path), Counter()).update(size._asdict())
    return {room: Size(**count) for room, count in sorted(rooms.items())}


def above(rooms: dict[str, Size], ceilings: dict[str, int]) -> list[str]:
    """A line for each room that is larger than its ceiling, or has none."""
    return [
        f"size: {room}: {size.tokens:,} tokens: at most {ceilings.get(room, 0):,} by tools/ceilings.toml: "
        "make it smaller, or raise it there with the reason"
        for room, size in rooms.items()
        if size.tokens > ceilings.get(room, 0)
    ]


def _write(rooms: dict[str, Size]) -> None:
    document = tomlkit.parse(CEILINGS.read_text(encoding="utf-8"))
    for room in set(document) - set(rooms):
        del document[room]
    for room, size in rooms.items():
        document[room] = -(-size.tokens // ROUNDED_TO) * ROUNDED_TO
    CEILINGS.write_text(tomlkit.dumps(document), encoding="utf-8")


def main(option: str = "") -> int:
    """Print, check or write; the exit code."""
    rooms = sizes()
    if option == "--write":
        _write(rooms)
        return 0
    if option == "--check":
        lines = above(rooms, tomlkit.parse(CEILINGS.read_text(encoding="utf-8")).unwrap())
        print(*lines, sep="\n", end="\n" * bool(lines), file=sys.stderr)
        return bool(lines)
    package = [size for room, size in rooms.items() if room.startswith("zeromethod/")]
    rooms["zeromethod"] = Size(*map(sum, zip(*package, strict=True)))
    for room, size in rooms.items():
        print(f"{room:26} {size.tokens:9,} tokens {size.numbers:6,} fixed numbers {size.compiled:5} compiled")
    return 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
