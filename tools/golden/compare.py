"""What differs between two tables, name by name: where first, in how many frames, by how much."""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from tools.golden.table import WORDS, Array, Table

WALL_CLOCK = {
    "loop_ms": "time of this processor",
    "draw_ms": "time of this processor",
    "read_ms": "time of this processor",
    "computing_hz": "from loop_ms",
    "checksums": "of a recording's rows, with the times in them",
    "versions.zeromethod": "which of both it is",
}
"""Names, by their end or a part of it, that differ from run to run, and why."""


def renamed(name: str, renames: Mapping[str, str]) -> str:
    """A name of the baseline's as it is now. renames: beginnings of names, old to new."""
    for old, new in renames.items():
        if name == old or name.startswith((f"{old}.", f"{old}[", f"{old}#")):
            return new + name[len(old) :]
    return name


def left_out(name: str) -> bool:
    """Whether it is a time of the wall clock."""
    return any(f".{name}.".find(f".{one}.") >= 0 for one in WALL_CLOCK)


def same(before: Array, after: Array) -> bool:
    """Whether both have the same type, shape and bits; any NaN is as good as another."""
    if before.dtype.kind in WORDS and after.dtype.kind in WORDS:
        return np.array_equal(before, after)
    if before.dtype != after.dtype or before.shape != after.shape:
        return False
    if before.dtype.kind == "f":
        before, after = (np.where(np.isnan(one), one.dtype.type("nan"), one) for one in (before, after))
    return before.tobytes() == after.tobytes()


def apart(before: Array, after: Array) -> tuple[float, float, str]:
    """Largest difference, over the largest number before, and in words what numbers do not say."""
    if before.shape != after.shape:
        return 0.0, 0.0, f"shape {before.shape} -> {after.shape}"
    if before.dtype.kind in WORDS or after.dtype.kind in WORDS:
        at = np.flatnonzero(np.ravel(before != after))[0]
        return 0.0, 0.0, f"{before.ravel()[at]!s:.60} -> {after.ravel()[at]!s:.60}"
    words = "" if before.dtype == after.dtype else f"{before.dtype} -> {after.dtype}"
    old, new = before.astype(float), after.astype(float)
    known = np.isfinite(old) & np.isfinite(new)
    if (lost := np.count_nonzero(np.isfinite(old) != np.isfinite(new))) and not words:
        words = f"{lost} of {old.size} finite in one only"
    most = float(np.abs(new - old).max(where=known, initial=0.0))
    size = float(np.abs(old).max(where=known, initial=0.0))
    return most, most / (size or most or 1.0), words


def differences(before: Table, after: Table, renames: Mapping[str, str] | None = None) -> Iterator[str]:
    """A line for each name that differs; places in sequences count as one name."""
    olds: dict[str, dict[Any, Array]] = defaultdict(dict)
    news: dict[str, dict[Any, Array]] = defaultdict(dict)
    for table, found, names in ((before, olds, renames or {}), (after, news, {})):
        for name in table:
            now = renamed(name, names)
            if not left_out(now):
                kind = re.sub(r"\[\d+\]", "[]", now)
                found[kind] |= {(frame, now): array for frame, array in table[name].items()}
    for name in sorted(olds | news):
        if line := _line(olds.get(name, {}), news.get(name, {})):
            yield f"{name}: {line}"


def _line(old: Mapping[Any, Array], new: Mapping[Any, Array]) -> str:
    """What differs of one name; "" where nothing does."""
    if not old or not new:
        return f"{'new' if new else 'gone'}, in {len({frame for frame, _ in old or new})} frames"
    parts = []
    for found, others, words in ((old, new, "missing"), (new, old, "added")):
        if frames := sorted({frame for frame, name in found.keys() - others.keys()}):
            parts.append(f"{words} in {len(frames)} frames from {frames[0]}")
    changed = sorted(key for key in old.keys() & new.keys() if not same(old[key], new[key]))
    if changed:
        largest, relative, words = zip(*(apart(old[key], new[key]) for key in changed), strict=True)
        count, total = len({frame for frame, _ in changed}), len({frame for frame, _ in old})
        line = f"{count} of {total} frames from {changed[0][0]}"
        if max(largest):
            line += f", at most {max(largest):.3g} ({max(relative):.2g} of the largest)"
        parts.append(", ".join([line, *next(([one] for one in words if one), [])]))
    return "; ".join(parts)
