"""What a change of method must hold, over scenes of a salt: figure with standard error, bar, verdict.

Each row is a benchmark with a stated number of scenes; its bars stand in the benchmark itself. Two rows run
side by side, those that judge speed alone; on two idle cores less than an hour in all. Results stay in
out/bars/SALT by the sources that made them: what is there already is not run again. A figure is not decided
where its bar is within one standard error. Some bars are shares of what another version has in the same
scenes: --against names the table that it wrote, out/bars/SALT/COMMIT.json.
"""

from __future__ import annotations

import json
import re
import subprocess
import sys
import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import click

from benchmarks.parts import fingerprint
from benchmarks.report import start
from zeromethod.cli.numbers import Whole
from zeromethod.cli.output import wide_console, write_summary
from zeromethod.errors import InputError
from zeromethod.view.table import text_table

FOLDER = Path("out/bars")
Json = dict[str, Any]


@dataclass(frozen=True)
class Row:
    """A benchmark as it is run; numbers in `words` are counts of scenes.

    minutes: of a core, on a machine so busy that it did some half of what an idle one does. salted: whether
    its scenes are random. alone: it judges speed.
    """

    name: str
    words: str
    minutes: float
    salted: bool = True
    alone: bool = False


ROWS = (
    Row("peaks", "peaks --presses 100", 2.1),
    Row("scenarios", "scenarios --scenarios 60", 5),
    Row("honesty", "honesty --presses 80", 15),
    Row("nuisances", "nuisances --frames 200", 1.4),
    Row("acquisition", "acquisition --scenes 60", 6),
    Row("folds", "folds --presses 16", 1.8),
    Row("calibration", "calibration_benches --benches 4", 6),
    Row("step", "step_response --seeds 10 --no-timings", 0.6),
    Row("faults-simulated", "fault_tour", 1, salted=False),
    Row("faults-contactless", "fault_tour --rig contactless", 1, salted=False),
    Row("faults-thin", "fault_tour --rig thin", 5, salted=False),
    Row("faults-printed", "fault_tour --rig printed", 2.5, salted=False),
    Row("contacts", "contacts", 4.6),
    Row("touches", "touches --touches 100 --frames 5000", 3.5),
    Row("force", "force --presses 10 --no-single", 5),
    Row("every-pixel", "every_pixel --part rest --part dents --seeds 3", 2.3),
    Row("thin", "thin --draws 4 --benches 0", 1.3),
    Row("rubbing", "rubbing", 4),
    Row("fabrics", "rubbing --part fabrics --quick", 3.3),
    Row("pointers", "interactive --touches 200", 4),
    Row("approach", "contactless --approaches 100 --minutes 60", 33),
    Row("lightings", "lightings --quick --no-sweep", 4.5, salted=False),
    Row("LEDs", "leds --part bars", 1.2, alone=True),
    Row("peers", "against_peers --part loop", 0.3, salted=False, alone=True),
    Row("live", "live_cost --quick", 2, salted=False, alone=True),
    Row("page", "page_cost --quick", 2, salted=False, alone=True),
)  # fmt: skip


def run(row: Row, folder: Path, salt: str, most: int | None) -> str:
    """Run a row, if its figures are not there already; why there are none, "" where there are."""
    file, part = folder / f"{row.name}.json", folder / f"{row.name}.part.json"
    if file.exists():
        return ""
    words = row.words
    if most is not None:
        words = re.sub(r"\b\d+\b", lambda count: str(min(int(count[0]), most)), words)
        words += "" if words != row.words or "--quick" in words else " --quick"
    click.echo(f"{row.name}, {row.minutes:g} min of a busy core: python -m benchmarks.{words}")
    began_s = time.monotonic()
    command = [sys.executable, "-m", *f"benchmarks.{words} --summary".split(), str(part)]
    command += ["--held-out", salt] if row.salted else []
    done = subprocess.run(command, capture_output=True, text=True, stdin=subprocess.DEVNULL, check=False)
    click.echo(f"{row.name}: {(time.monotonic() - began_s) / 60:.1f} min")
    if done.returncode in (0, 1) and part.exists():
        part.replace(file)
        return ""
    lines = done.stderr.strip().splitlines()
    return f"exit code {done.returncode}: {lines[-1] if lines else 'without a word'}"


def verdict(figure: Json, other: Json | None) -> str:
    """Of a figure against its bar; other: the same one of another version."""
    number, error, ends = figure["number"], figure["error"] or 0.0, (figure["least"], figure["most"])
    if number is None:
        return "missed"
    if figure["of_other"]:
        if other is None or other["number"] is None:
            return "nothing to compare with"
        # the same scenes: their scatter is in both alike
        ends, error = tuple(end and end * other["number"] for end in ends), 0.0
    if any(end is not None and abs(number - end) < error for end in ends):
        return "not decided"
    least, most = ends
    return "met" if (least is None or number >= least) and (most is None or number <= most) else "missed"


def judged(row: Row, folder: Path, why: str, others: Sequence[Json]) -> list[Json]:
    """A row's figures with verdicts; one entry that says why where there are none."""
    file = folder / f"{row.name}.json"
    figures = json.loads(file.read_text())["figures"] if file.exists() else []
    found = []
    for figure in figures:
        if figure["bar"] and (figure["least"] is not None or figure["most"] is not None):
            other = next((o for o in others if (o["row"], o["name"]) == (row.name, figure["name"])), None)
            found.append({"row": row.name, **figure, "verdict": verdict(figure, other)})
    nothing = {"name": "", "value": "", "bar": "", "number": None}
    why = why or "no figure with a bar"
    return found or [{"row": row.name, **nothing, "verdict": f"not run: {why}"}]


def _salt(_context: click.Context, _option: click.Parameter, salt: str) -> str:
    if not re.fullmatch(r"\w[\w.-]{0,63}", salt):
        raise InputError(
            f"--salt: {salt!r}: up to 64 letters, digits, '-', '_' and '.', a letter or digit first"
        )
    return salt


def _others(file: Path, salt: str, most: int | None) -> list[Json]:
    """Figures of another version's table, in the same scenes."""
    try:
        table = json.loads(file.read_text())
        scenes, rows = (table["salt"], table["most_scenes"]), list(table["rows"])
    except (ValueError, KeyError, TypeError):
        raise InputError(f"--against: {file}: not a table of this command") from None
    if scenes != (salt, most):
        raise InputError(f"--against: {file}: of other scenes: the salt must be {salt}, the rows as large")
    return rows


def _commit() -> str:
    done = subprocess.run(
        ["git", "describe", "--always", "--dirty"], capture_output=True, text=True, check=False
    )
    return done.stdout.strip() or fingerprint()


@click.command(
    "bars", help=__doc__, epilog="Example: make bars SALT=kestrel ARGS='--only peaks --only folds'"
)
@click.option("--salt", required=True, callback=_salt, help="Draws the scenes; new to accept a method by.")
@click.option(
    "--only", multiple=True, type=click.Choice([row.name for row in ROWS]), help="This row; may be repeated."
)
@click.option(
    "--most-scenes", "most", type=Whole(min=1), help="Of each row, to try the commands; decides nothing."
)
@click.option(
    "--against", type=click.Path(exists=True, dir_okay=False, path_type=Path), help="Another version's."
)
def command(salt: str, only: tuple[str, ...], most: int | None, against: Path | None) -> None:
    """Run what is missing, print and keep the table; exit code 1 where a bar is missed or a row not run."""
    others = [] if against is None else _others(against, salt, most)
    size = "" if most is None else f"-{most}"
    folder = FOLDER / salt / f"{fingerprint()}{size}"
    folder.mkdir(parents=True, exist_ok=True)
    rows = sorted((row for row in ROWS if not only or row.name in only), key=lambda row: -row.minutes)
    one = partial(run, folder=folder, salt=salt, most=most)
    beside, alone = ([row for row in rows if row.alone is it] for it in (False, True))
    with ThreadPoolExecutor(2) as pool:
        why = dict(zip([row.name for row in beside], pool.map(one, beside), strict=True))
    why |= {row.name: one(row) for row in alone}
    shown = [row for row in ROWS if row in rows or (folder / f"{row.name}.json").exists()]
    found = [entry for row in shown for entry in judged(row, folder, why.get(row.name, ""), others)]
    lines = [(entry["row"], entry["name"], entry["value"], entry["bar"], entry["verdict"]) for entry in found]
    wide_console(250).print(text_table(("row", "figure", "value ± standard error", "bar", "verdict"), lines))
    commit, left_out = _commit(), [row.name for row in ROWS if row not in shown]
    table = FOLDER / salt / f"{commit}{size}.json"
    write_summary(
        table, {"salt": salt, "commit": commit, "most_scenes": most, "left_out": left_out, "rows": found}
    )
    click.echo(f"{table}" + (f"; not run, left out by --only: {', '.join(left_out)}" if left_out else ""))
    if any(entry["verdict"].startswith(("missed", "not run")) for entry in found):
        click.get_current_context().exit(1)


if __name__ == "__main__":
    start(command)
