"""Check the docstrings of everything that `import zeromethod as zm` offers, by numpydoc.

Which checks: `[tool.zeromethod.api-docs]` in pyproject.toml. Besides those, every InputError and
MeasurementError that a function raises itself must be listed under Raises.
"""

from __future__ import annotations

import ast
import enum
import inspect
import sys
import textwrap
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from api_reference import public_members
from numpydoc.docscrape import ClassDoc, FunctionDoc
from numpydoc.validate import validate

import zeromethod as zm

CONFIG = Path(__file__).parent.parent / "pyproject.toml"


def problems() -> Iterator[str]:
    """One line for everything that is missing or wrong."""
    config = tomllib.loads(CONFIG.read_text())["tool"]["zeromethod"]["api-docs"]
    checks = set(config["checks"])
    for name in zm.__all__:
        if name.startswith("_"):
            continue
        found = getattr(zm, name)
        yield from _of(name, found, checks)
        if inspect.isclass(found):
            for member, value in public_members(found):
                if {name, f"{name}.{member}"} & set(config["short"]):
                    continue
                yield from _of(f"{name}.{member}", value, checks)


def _of(name: str, found: Any, checks: set[str]) -> Iterator[str]:
    ignored: tuple[str, ...] = ()
    if inspect.isclass(found) and (issubclass(found, enum.Enum) or ClassDoc(found)["Attributes"]):
        ignored = ("PR",)  # what a class lists as attributes are its parameters, too
    elif inspect.isfunction(found) and FunctionDoc(found)["Yields"]:
        ignored = ("RT",)
    for code, message in validate(f"zeromethod.{name}")["errors"]:
        if code in checks and not code.startswith(ignored or "none"):
            yield f"zm.{name}: {code} {message}"
    if inspect.isfunction(found):
        listed = {one.type for one in FunctionDoc(found)["Raises"]}
        for error in sorted(_raised(found) - listed):
            yield f"zm.{name}: raises {error}, which Raises does not list"


def _raised(found: Any) -> set[str]:
    tree = ast.parse(textwrap.dedent(inspect.getsource(found)))
    calls = (node.exc for node in ast.walk(tree) if isinstance(node, ast.Raise))
    names = {call.func.id for call in calls if isinstance(call, ast.Call) and isinstance(call.func, ast.Name)}
    return names & {"InputError", "MeasurementError"}


if __name__ == "__main__":
    lines = list(problems())
    print("\n".join(lines) or "every docstring of the public API is complete")
    sys.exit(bool(lines))
