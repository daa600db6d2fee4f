"""The libraries that only exports need (extra `export`)."""

from __future__ import annotations

import importlib
from typing import Any

from zeromethod.errors import InputError


def needed(module: str) -> Any:
    """Import a module of the extra. Raises InputError that says how to install it."""
    try:
        return importlib.import_module(module)
    except ImportError as error:
        library = module.partition(".")[0]
        raise InputError(f"export: needs the library {library}: pip install 'zeromethod[export]'") from error
