"""`make golden` and `make golden-baseline`: python -m tools.golden [--baseline | NAME ...]."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from tools.golden.compare import differences
from tools.golden.table import load

HERE = Path(__file__).parent
ROOT = HERE.parent.parent
BASELINE = tomllib.loads((HERE / "baseline.toml").read_text(encoding="utf-8"))
FOLDER = ROOT / "out" / "golden" / BASELINE["commit"][:12]
NAMES = [
    name for name in tomllib.loads((HERE / "scenarios.toml").read_text(encoding="utf-8")) if name != "presses"
]

PROCESSES = 2
"""Scenarios played at once: "two idle cores" is what its time is given for."""


def played(python: Path, tree: Path, folder: Path, names: list[str]) -> Iterator[tuple[str, str]]:
    """Play scenarios with the package and, where it has one, the player of a tree; else with this tree's.

    Gives each one's name, in order, and the last words of one that failed, "" for none.
    """
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    # one thread each: sums by several depend on how they share the work
    threads = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "LP_NUM_THREADS"), "1")
    setting = os.environ | threads | {"PYTHONPATH": os.pathsep.join(map(str, (tree, ROOT)))}

    def play(name: str) -> str:
        program = [python, "-P", "-m", "tools.golden.play", name, folder / f"{name}.npz"]
        end = subprocess.run(program, cwd=tree, env=setting, capture_output=True, text=True, check=False)
        return (end.stderr.strip().splitlines() or ["no words"])[-1] if end.returncode else ""

    with ThreadPoolExecutor(PROCESSES) as pool:
        yield from zip(names, pool.map(play, names), strict=True)


def make_baseline() -> int:
    """Check the baseline's commit out, give it an environment with the libraries of this one, play it."""
    tree, environment = FOLDER / "tree", FOLDER / "environment"
    python = environment / "bin" / "python"

    setting = os.environ | {"PYTHONPATH": str(tree)}

    def call(*words: object) -> str:
        program = [str(one) for one in words]
        end = subprocess.run(program, cwd=ROOT, env=setting, check=True, text=True, stdout=subprocess.PIPE)
        return end.stdout

    if not tree.exists():
        call("git", "worktree", "prune")
        call("git", "worktree", "add", "--detach", tree, BASELINE["commit"])
    if not python.exists():
        call(sys.executable, "-m", "venv", environment)
    libraries = call(sys.executable, "-m", "pip", "freeze", "--exclude-editable", "--exclude", "zeromethod")
    constraints = FOLDER / "libraries.txt"
    constraints.write_text(libraries, encoding="utf-8")
    call(python, "-m", "pip", "install", "--quiet", "--constraint", constraints, "--editable", tree)
    call(environment / "bin" / "zeromethod", "compile")
    failed = [f"{name}: {why}" for name, why in played(python, tree, FOLDER / "played", NAMES) if why]
    print(*failed, f"{len(NAMES) - len(failed)} of {len(NAMES)} scenarios played in {FOLDER}", sep="\n")
    return bool(failed)


def compare(names: list[str]) -> int:
    """Play scenarios with this tree, and print what differs from the baseline."""
    if unknown := sorted(set(names) - set(NAMES)):
        print(f"golden: {unknown[0]}: not a scenario: {', '.join(NAMES)}", file=sys.stderr)
        return 2
    if not (FOLDER / "played").is_dir():
        print(
            f"golden: no baseline of {BASELINE['commit'][:12]} on this machine: make golden-baseline",
            file=sys.stderr,
        )
        return 2
    now = ROOT / "out" / "golden" / "now"
    differing = 0
    for name, why in played(Path(sys.executable), ROOT, now, names):
        before = FOLDER / "played" / f"{name}.npz"
        lines = [why] if why else ["new scenario"] if not before.exists() else None
        if lines is None:
            after = load(now / before.name)
            lines = list(differences(load(before), after, BASELINE["renames"]))
            arrays = sum(map(len, after.values()))
            print(
                f"{name}: {arrays} arrays of {len(after)} names, {len(lines) or 'no'} names differ",
                flush=True,
            )
        print(*(f"  {name}  {line}" for line in lines), sep="\n", end="\n" * bool(lines), flush=True)
        differing += bool(lines)
    print(f"golden: {differing or 'none'} of {len(names)} scenarios differ from {BASELINE['commit'][:12]}")
    return bool(differing)


if __name__ == "__main__":
    arguments = sys.argv[1:]
    try:
        sys.exit(make_baseline() if arguments == ["--baseline"] else compare(arguments or NAMES))
    except subprocess.CalledProcessError as error:
        sys.exit(f"golden: {' '.join(error.cmd)}: exit code {error.returncode}")
