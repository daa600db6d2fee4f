"""What a person reads while functions are compiled on a new machine."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

PROGRAM = """
from zeromethod.compiling import report_compiling
report_compiling(print)
import numpy as np
from zeromethod.warp.compose import compose
q = np.zeros((8, 8, 2))
compose(q, q, 8.0)
"""


def said(cache: Path) -> str:
    setting = {**os.environ, "NUMBA_CACHE_DIR": str(cache)}
    return subprocess.run(
        [sys.executable, "-c", PROGRAM], env=setting, check=True, capture_output=True, text=True
    ).stdout


def test_compiling_is_said_once_on_a_new_machine(tmp_path: Path) -> None:
    assert said(tmp_path).startswith("compiling, once on a new machine: warp\n")
    assert said(tmp_path) == ""
