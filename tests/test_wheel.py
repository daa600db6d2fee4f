"""The wheel on its own: built, installed into a fresh environment, run from another folder."""

import os
import shutil
import subprocess
import sys
import venv
from importlib import metadata
from pathlib import Path

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT = Path(__file__).parent.parent


def _run(*command: str | Path, cwd: Path) -> str:
    # PYTHONPATH would let the checkout shine through and hide a file missing from the wheel.
    environment = {key: value for key, value in os.environ.items() if key != "PYTHONPATH"}
    done = subprocess.run(
        [str(part) for part in command], cwd=cwd, env=environment, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, f"{command}\n{done.stdout}\n{done.stderr}"
    return done.stdout


def _take_compiled_code(package: Path) -> None:
    """Numba's, as far as it is there for these sources: compiling all of a run's takes half a minute."""
    for source in (ROOT / "zeromethod").rglob("*.py"):
        copy = package / source.relative_to(ROOT / "zeromethod")
        assert copy.read_bytes() == source.read_bytes()
        # numba takes code only for a source of the same time as the one that it was made of
        os.utime(copy, ns=(source.stat().st_atime_ns, source.stat().st_mtime_ns))
        for compiled in source.parent.glob(f"__pycache__/{source.stem}.*.nb[ic]"):
            (copy.parent / "__pycache__").mkdir(exist_ok=True)
            shutil.copy(compiled, copy.parent / "__pycache__")


def _declared(package: metadata.Distribution, found: dict[str, metadata.Distribution]) -> None:
    """Collect the distributions that a package asks for, without extras, and those that these ask for."""
    for text in package.requires or ():
        asked = Requirement(text)
        name = canonicalize_name(asked.name)
        if name not in found and (asked.marker is None or asked.marker.evaluate({"extra": ""})):
            found[name] = metadata.distribution(name)
            assert asked.specifier.contains(found[name].version, prereleases=True), asked
            _declared(found[name], found)


def _lend_what_is_declared(folder: Path) -> None:
    """Links to what the metadata of the wheel installed there ask for, as it is here, and to nothing else."""
    found: dict[str, metadata.Distribution] = {}
    (zeromethod,) = metadata.distributions(name="zeromethod", path=[str(folder)])
    _declared(zeromethod, found)
    for one in found.values():
        for top in {file.parts[0] for file in one.files or ()} - {"..", "__pycache__"}:
            (folder / top).symlink_to(one.locate_file(top))


def test_the_wheel_carries_shaders_and_rigs_and_runs_elsewhere(tmp_path):
    pip = [sys.executable, "-m", "pip", "--quiet", "--disable-pip-version-check"]
    _run(*pip, "wheel", "--no-deps", "--wheel-dir", tmp_path, ROOT, cwd=tmp_path)
    (wheel,) = tmp_path.glob("zeromethod-*.whl")

    venv.create(tmp_path / "fresh")
    python = tmp_path / "fresh" / "bin" / "python"
    _run(*pip, "--python", python, "install", "--no-compile", "--no-deps", wheel, cwd=tmp_path)
    _lend_what_is_declared(next((tmp_path / "fresh").glob("lib/*/site-packages")))
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()

    shaders = _run(
        python, "-c", "from zeromethod.resources import resource; print(resource('shaders'))", cwd=elsewhere
    )
    assert Path(shaders.strip()).is_relative_to(tmp_path / "fresh")
    _take_compiled_code(Path(shaders.strip()).parents[1])
    # the names are loaded from a stub, which must be there
    names = "import zeromethod as zm; print(zm.__all__)"
    studies = "from zeromethod.resources import resource; print(*resource('studies').glob('*.toml'))"
    printed = _run(python, "-c", f"{names}\n{studies}", cwd=elsewhere).splitlines()
    assert "Session" in printed[0]
    assert len(printed[1].split()) >= 4
    command = tmp_path / "fresh" / "bin" / "zeromethod"
    assert "zeromethod, version" in _run(command, "--version", cwd=elsewhere)
    _run(
        command, "run", "--frames", "8", "--scenario", "none", "--summary", "run.json", "--record", "run.h5",
        cwd=elsewhere,
    )  # fmt: skip
    assert (elsewhere / "run.json").is_file()
    _run(command, "report", "run.h5", cwd=elsewhere)
    assert (elsewhere / "run.html").is_file()
    assert not list((tmp_path / "fresh").rglob("benchmarks"))
