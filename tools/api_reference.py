"""Print docs/api.md: everything that `import zeromethod as zm` offers, from its docstrings.

python tools/api_reference.py > docs/api.md
"""

from __future__ import annotations

import enum
import inspect
import re
import sys
import textwrap
from collections.abc import Iterator
from typing import Any

import zeromethod as zm

_HEAD = """# Python API

Everything that `import zeromethod as zm` offers, generated from the docstrings by
`python tools/api_reference.py > docs/api.md`.
"""

_SECTION = re.compile(r"^(\w[\w ]*)\n-{3,}\n", flags=re.MULTILINE)
_ENTRIES = ("Parameters", "Attributes", "Returns", "Yields", "Raises")


def reference() -> str:
    """Text of the whole page."""
    names = [name for name in zm.__all__ if not name.startswith("_")]
    groups = {
        "Functions": [name for name in names if inspect.isfunction(getattr(zm, name))],
        "Classes": [name for name in names if inspect.isclass(getattr(zm, name))],
    }
    parts = [_HEAD]
    for title, members in groups.items():
        parts.append(f"## {title}\n")
        parts += [_entry(name, getattr(zm, name)) for name in members]
    return "\n".join(parts)


def public_members(kind: type) -> Iterator[tuple[str, Any]]:
    """Methods and properties that a class of this package has for its users, in their order."""
    if issubclass(kind, enum.Enum | BaseException):
        return
    for name, member in vars(kind).items():
        if name.startswith("_"):
            continue
        found = getattr(member, "__func__", member)  # a class method's
        if inspect.isfunction(found) or isinstance(found, property):
            yield name, found


def _entry(name: str, found: Any) -> str:
    lines = [
        f"### `{name}`\n",
        f"```python\n{_signature(name, found)}\n```\n",
        _markdown(inspect.getdoc(found)),
    ]
    if inspect.isclass(found):
        if issubclass(found, enum.Enum):
            lines.append("\n".join(f"- `{member.name}`: {member.value}" for member in found) + "\n")
        for member, value in public_members(found):
            text = f"#### `{name}.{member}`\n\n"
            if not isinstance(value, property):
                text += f"```python\n{_signature(member, value)}\n```\n\n"
            lines.append(text + _markdown(inspect.getdoc(value)))
    return "\n".join(lines)


def _signature(name: str, found: Any) -> str:
    """Call as it is written, without the annotations, which the text below has in words."""
    if inspect.isclass(found) and issubclass(found, enum.Enum | BaseException):
        return f"class {name}"
    signature = inspect.signature(found)
    shown = [
        parameter.replace(annotation=inspect.Parameter.empty, default=_default(parameter.default))
        for parameter in signature.parameters.values()
        if parameter.name not in ("self", "cls")
    ]
    call = signature.replace(parameters=shown, return_annotation=inspect.Signature.empty)
    return f"{'class ' if inspect.isclass(found) else ''}{name}{call}"


def _default(value: Any) -> Any:
    """What prints with its address, or as a dataclass's factory, is left out."""
    return ... if "factory" in repr(value) or " at 0x" in repr(value) else value


def _markdown(text: str | None) -> str:
    """A docstring's sections as lists, its examples as code."""
    first, *rest = _SECTION.split(text or "")
    parts = [first.strip() + "\n"]
    for title, body in zip(rest[::2], rest[1::2], strict=True):
        content = textwrap.dedent(body).strip()
        if title in _ENTRIES:
            content = "\n".join(_items(content))
        elif title == "Examples":
            content = f"```python\n{content}\n```"
        parts.append(f"**{title}**\n\n{content}\n")
    return "\n".join(parts)


def _items(body: str) -> Iterator[str]:
    """`name : type` with the indented lines under it as one item each."""
    for line in body.splitlines():
        if line and not line.startswith(" "):
            name, _, kind = line.partition(" : ")
            yield f"- `{name}`" + (f" ({kind})" if kind else "")
        elif line:
            yield f"  {line.strip()}"


if __name__ == "__main__":
    sys.stdout.write(reference())
