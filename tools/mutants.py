"""Plant faults and see whether the suite fails: python -m tools.mutants [--list] [--only WORDS ...].

Each fault of tests/mutants.toml is planted into a copy of the files that git knows, as they are now, together
with what is compiled of them. First the tests run that should see it, up to the first failure; where they
pass, the whole suite. A line for each fault says which test caught it; exit code 1 if one survived, 2 if the
list does not fit the tree any more. It says nothing where the suite fails anyway: first `make test`.
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
import time
import tomllib
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parent.parent
LIST = ROOT / "tests" / "mutants.toml"

PROCESSES = 2
"""Faults tried at once."""

_WHOLE_SUITE = ("-n", "4", "-m", "not long")


class Mutant(NamedTuple):
    """A fault: what stands in the file in place of `old`, and the tests that should see it."""

    name: str
    file: str
    old: str
    new: str
    tests: list[str]


def mutants() -> list[Mutant]:
    """All that are listed."""
    return [Mutant(**one) for one in tomllib.loads(LIST.read_text(encoding="utf-8"))["mutant"]]


def unfit(listed: Sequence[Mutant], root: Path = ROOT) -> list[str]:
    """A line for each fault that cannot be planted as it is listed."""
    lines = []
    for one in listed:
        times = (
            (root / one.file).read_text(encoding="utf-8").count(one.old) if (root / one.file).exists() else 0
        )
        if times != 1:
            lines.append(f"mutants: {one.name}: {one.file}: {one.old!r} is in it {times} times, not once")
        missing = [test for test in one.tests if not (root / test).exists()]
        lines += [f"mutants: {one.name}: {test}: there is no such test" for test in missing]
    return lines


def copy_tree(to: Path) -> None:
    """Copy the files that git knows, and what is compiled of the package.

    Times of files stay, as by them compiled functions are known to be of these sources.
    """
    listed = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, text=True, check=True)
    compiled = (str(one.relative_to(ROOT)) for one in (ROOT / "zeromethod").rglob("__pycache__/*"))
    for name in (*listed.stdout.rstrip("\0").split("\0"), *compiled):
        if (ROOT / name).is_file():
            (to / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(ROOT / name, to / name)


def caught_by(tree: Path, arguments: Sequence[str]) -> str:
    """Name of the first test that fails in a tree, "" where none does. RuntimeError where none could run."""
    threads = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "LP_NUM_THREADS"), "1")
    program = [sys.executable, "-m", "pytest", "-x", "-q", "-p", "no:cacheprovider", *arguments]
    setting = os.environ | threads | {"PYTHONPATH": str(tree)}
    end = subprocess.run(program, cwd=tree, env=setting, capture_output=True, text=True, check=False)
    if end.returncode == 0:
        return ""
    # a file that cannot be imported is named without a test: that is no test's merit
    failed = [one for one in end.stdout.splitlines() if one.startswith(("FAILED ", "ERROR ")) and "::" in one]
    if not failed:
        raise RuntimeError((end.stdout + end.stderr).strip()[-2000:])
    return failed[0].split(maxsplit=1)[1].partition(" - ")[0].partition("[")[0]


def tried(one: Mutant, arguments: Sequence[str]) -> tuple[str, float]:
    """Plant a fault and run tests: the one that caught it, "" for none, and how long that took, s."""
    begin = time.monotonic()
    with tempfile.TemporaryDirectory(prefix="zeromethod-mutant-") as folder:
        tree = Path(folder)
        copy_tree(tree)
        file = tree / one.file
        file.write_text(file.read_text(encoding="utf-8").replace(one.old, one.new), encoding="utf-8")
        return caught_by(tree, arguments), time.monotonic() - begin


def all_tried(listed: Sequence[Mutant]) -> Iterator[tuple[Mutant, str, float]]:
    """Each fault, the test that caught it, "" for none, and s; by the whole suite one after the other."""
    passed = []
    with ThreadPoolExecutor(PROCESSES) as pool:
        found = pool.map(lambda one: tried(one, one.tests), listed)
        for one, (test, seconds) in zip(listed, found, strict=True):
            if test:
                yield one, test, seconds
            else:
                passed.append((one, seconds))
    for one, before in passed:
        test, seconds = tried(one, _WHOLE_SUITE)
        yield one, test and f"{test} (not by {', '.join(one.tests)})", before + seconds


def main() -> int:
    """Run it; the exit code."""
    parser = argparse.ArgumentParser(prog="python -m tools.mutants", description=__doc__.partition(":")[0])
    parser.add_argument("--list", action="store_true", help="names of the faults, and no more")
    parser.add_argument("--only", nargs="+", metavar="WORDS", help="faults with one of these in their name")
    given = parser.parse_args()
    listed = [one for one in mutants() if not given.only or any(words in one.name for words in given.only)]
    if given.list:
        print(*(one.name for one in listed), sep="\n")
        return 0
    if lines := unfit(listed):
        print(*lines, sep="\n", file=sys.stderr)
        return 2
    survived = 0
    try:
        for one, test, seconds in all_tried(listed):
            print(f"{one.name}: {f'caught by {test}' if test else 'NOT CAUGHT'}, {seconds:.0f} s", flush=True)
            survived += not test
    except RuntimeError as error:
        print(f"mutants: tests could not run:\n{error}", file=sys.stderr)
        return 2
    print(f"mutants: {len(listed) - survived} of {len(listed)} caught")
    return bool(survived)


if __name__ == "__main__":
    sys.exit(main())
