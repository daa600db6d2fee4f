"""The limit that the system sets to a file's size, in words."""

from __future__ import annotations

import resource


def size_limit() -> str:
    """Why a file may not grow: "the limit of a file's size, 10 MB (ulimit -f), is reached"."""
    limit = resource.getrlimit(resource.RLIMIT_FSIZE)[0]
    size = "" if limit == resource.RLIM_INFINITY else f", {limit / 1e6:.3g} MB (ulimit -f),"
    return f"the limit of a file's size{size} is reached"
