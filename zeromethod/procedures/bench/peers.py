"""The peers' own code, plain functions written for comparison: from a checkout or out of the wheel."""

from __future__ import annotations

import importlib.util
import sys
from functools import cache
from types import ModuleType

from zeromethod.resources import resource


@cache
def peer(name: str) -> ModuleType:
    """Module `benchmarks/peers/<name>.py`. Raises ImportError when it does not lie where it should."""
    path = resource("benchmarks", "peers", f"{name}.py")
    qualified = f"zeromethod_peers.{name}"
    spec = importlib.util.spec_from_file_location(qualified, path)
    if spec is None or spec.loader is None or not path.is_file():
        raise ImportError(f"the peer {name!r} is not at {path}")
    module = importlib.util.module_from_spec(spec)
    sys.modules[qualified] = module  # dataclasses look their module up while they are made
    spec.loader.exec_module(module)
    return module
