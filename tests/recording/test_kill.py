"""A writer that is killed anywhere in a flush leaves no row without what it names."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from zeromethod.recording.frames_in import frames_in
from zeromethod.recording.recording import Recording

LINES = range(3, 1003, 40)
"""After how many lines of the second flush it is killed: all through it, and past its end."""

PROGRAM = """
import os, shutil, signal, sys
from pathlib import Path
import numpy as np
from planted_steps import a_step, bench, fine_shape, read, read_fine
from zeromethod.recording.file import about, create, rest_arrays
from zeromethod.recording.growing import GrowingFile
from zeromethod.recording.message import Write
from zeromethod.recording.rows import Rows, WaitingFine, WaitingReading, WaitingStep
from zeromethod.recording.schema import KEEP, parts

rig, rest = bench()
image = rig.camera.rows, rig.camera.columns
found = parts(image, rig.camera.bits, rest.grid.shape, list(KEEP), 1, fine_shape())
names = list(found)
run = {"keep": list(KEEP), "every": 1, "command_line": "", "live": False, "compressed": False}
run |= {"gl_renderer": "", "calibration": ""}
empty = Path(sys.argv[1]) / "empty.h5"
create(empty, found, about(rig) | run, rest_arrays(rest), {})
steps = {number: read_fine(read(a_step(number))) for number in (1, 2, 3)}

def write(file, rows, number):
    step = steps[number]
    added = rows.of_step(WaitingStep(step, 1, False, 0)), rows.of_reading(WaitingReading(step, 1))
    for one in (*added, rows.of_fine(WaitingFine(step, 1))):
        for when, name, array in one:
            if when is not Write.WITHOUT_ROOM:
                item = np.ascontiguousarray(array, found[name].dtype)
                file.append(names.index(name), memoryview(item.tobytes()))

def killed(path, lines):
    shutil.copy(empty, path)
    file, rows = GrowingFile(path, names), Rows(found)
    write(file, rows, 1)
    file.flush()
    write(file, rows, 2)
    write(file, rows, 3)
    left = lines

    def count(frame, event, argument):
        nonlocal left
        left -= event == "line"
        if left == 0:
            os.kill(os.getpid(), signal.SIGKILL)
        return count

    sys.settrace(lambda frame, event, argument: count if frame.f_code.co_name == "flush" else None)
    file.flush()
    os.kill(os.getpid(), signal.SIGKILL)

for lines in map(int, sys.argv[2:]):
    child = os.fork()
    if child == 0:
        killed(Path(sys.argv[1]) / f"{lines}.h5", lines)
    os.waitpid(child, 0)
empty.unlink()
"""


@pytest.fixture(scope="module")
def left(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    folder = tmp_path_factory.mktemp("killed")
    program = f"import sys; sys.path.insert(0, {str(Path(__file__).parent.parent)!r})\n{PROGRAM}"
    subprocess.run([sys.executable, "-c", program, str(folder), *map(str, LINES)], check=True)
    return sorted(folder.glob("*.h5"))


def test_what_a_row_names_is_there_wherever_the_kill_falls(left: list[Path]) -> None:
    assert len(left) == len(LINES)
    seen, fine_seen = set(), set()
    for path in left:
        with Recording(path) as found:
            numbers = found.steps["number"].tolist()
            seen.add(len(numbers))
            for number in numbers:
                assert found.image(number) is not None, path.name
                assert found.measured(number) is not None, path.name
                assert found.surface(number) is not None, path.name
            for number in found.fine_peaks["step"].tolist():
                fine = found.fine(number)
                assert fine is not None, path.name
                assert fine.valid.all(), path.name
            fine_seen.add(len(found.fine_peaks))
            assert set(found.peaks["step"].tolist()) <= set(found.steps_with("surface").tolist())
            shown = np.isin(found.steps["number"], found.steps_with("frames")).sum()
        # what the recorder says is kept is what the file has
        assert frames_in(path, lambda step: True) == len(numbers) == shown
    # killed before the rows, and after them
    assert seen == fine_seen == {1, 3}
