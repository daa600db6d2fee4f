"""Procedures that a study may name: those of this package, or a lab's own by `module:NAME`."""

from __future__ import annotations

import importlib
import os
import sys

from zeromethod.errors import InputError
from zeromethod.rig.refusal import shown
from zeromethod.study.averaging import AVERAGING
from zeromethod.study.closed_loop import CLOSED_LOOP
from zeromethod.study.depth_errors import DEPTH_ERROR
from zeromethod.study.limits import DESIGN
from zeromethod.study.rereading import REREAD
from zeromethod.study.task import Procedure

PROCEDURES = {
    "run": CLOSED_LOOP,
    "averaging": AVERAGING,
    "design": DESIGN,
    "depth_error": DEPTH_ERROR,
    "reread": REREAD,
}


def procedure(name: str) -> Procedure:
    """Procedure by name, or by `package.module:NAME` (the working directory is searched too).

    Raises InputError, one line, where there is none.
    """
    if name in PROCEDURES:
        return PROCEDURES[name]
    module, _, attribute = name.partition(":")
    allowed = f"one of {', '.join(PROCEDURES)}, or package.module:NAME of a Procedure"
    if not (module and attribute):
        raise InputError(f"procedure: {shown(name)}: {allowed}")
    if os.getcwd() not in sys.path:
        sys.path.append(os.getcwd())
    try:
        found = getattr(importlib.import_module(module), attribute)
    except (ImportError, AttributeError) as error:
        raise InputError(f"procedure: {shown(name)}: {error}: {allowed}") from None
    if not isinstance(found, Procedure):
        raise InputError(f"procedure: {shown(name)}: a {type(found).__name__}: {allowed}")
    return found
