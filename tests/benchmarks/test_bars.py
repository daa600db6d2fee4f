"""Verdicts of `make bars` from planted summaries, and scenes that follow from a salt."""

import json
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from command_line import run

from benchmarks import bars, salt, scenarios
from benchmarks.parts import fingerprint
from benchmarks.report import Figure, Report, benchmark, figure
from benchmarks.totals import estimate, rate
from zeromethod.cli.output import write_summary
from zeromethod.rig.tables import Rubber

ROWS = tuple(bars.Row(name, name, 0.0) for name in ("planted", "missing", "done"))
FIGURES = {
    "met": figure("a", 0.004, 0.001, unit="%", most=0.01),
    "missed": figure("b", 0.02, 0.001, unit="%", most=0.01),
    "not decided": figure("c", 0.011, 0.002, least=0.0, most=0.01),
    "nothing to compare with": figure("d", 97.0, 5.0, least=0.98, of_other=True),
}


def judged_rows(folder: Path, monkeypatch: Any, *words: Any) -> tuple[int, dict[str, str], list[str]]:
    """Exit code, verdicts by row and figure, and modules that were started."""
    started: list[str] = []

    def planted(command: list[str], **_: Any) -> Any:
        module, file = command[2], Path(command[command.index("--summary") + 1])
        started.append(module)
        assert command[-2:] == ["--held-out", "kestrel"]
        if module == "benchmarks.planted":
            every = [*FIGURES.values(), Figure("of no bar", "7")]
            write_summary(file, {"figures": [asdict(one) for one in every]})
        return type("Done", (), {"returncode": 1, "stderr": "first\nno such bench\n"})

    monkeypatch.chdir(folder)
    monkeypatch.setattr(bars, "ROWS", ROWS)
    monkeypatch.setattr(bars, "_commit", lambda: "c0ffee")
    monkeypatch.setattr("benchmarks.bars.subprocess.run", planted)
    code, out, _ = run("--salt kestrel", *words, command=bars.command)
    assert "verdict" in out
    table = json.loads((folder / "out/bars/kestrel/c0ffee.json").read_text())
    return code, {f"{one['row']} {one['name']}".strip(): one["verdict"] for one in table["rows"]}, started


def test_rows_are_judged_from_their_summaries_and_not_run_again(tmp_path, monkeypatch):
    done = tmp_path / "out/bars/kestrel" / fingerprint() / "done.json"
    done.parent.mkdir(parents=True)
    done.write_text(json.dumps({"figures": [asdict(figure("e", 3.0, most=4.0))]}))
    code, verdicts, started = judged_rows(tmp_path, monkeypatch)
    assert code == 1
    assert verdicts == {
        "planted a": "met",
        "planted b": "missed",
        "planted c": "not decided",
        "planted d": "nothing to compare with",
        "missing": "not run: exit code 1: no such bench",
        "done e": "met",
    }
    assert sorted(started) == ["benchmarks.missing", "benchmarks.planted"]
    table = tmp_path / "out/bars/kestrel/c0ffee.json"
    other = tmp_path / "other.json"
    for theirs, verdict in ((98.0, "met"), (99.5, "missed")):  # 97 over 0.98 is 98.98
        other.write_text(table.read_text().replace("97.0", str(theirs)))
        _, verdicts, started = judged_rows(tmp_path, monkeypatch, "--against", other)
        assert verdicts["planted d"] == verdict
        assert started == ["benchmarks.missing"]
    other.write_text(table.read_text().replace('"kestrel"', '"heron"'))
    assert run("--salt kestrel --against", other, command=bars.command).code == 2


def test_what_is_not_within_a_bar_or_not_read_is_missed():
    assert figure("a", float("nan"), most=1.0).met is False
    assert figure("a", np.float64(2.0), most=1.0).met is False  # and no numpy bool, which `is False` never is
    nothing = {"number": None, "error": None, "least": None, "most": 1.0, "of_other": False}
    assert bars.verdict(nothing, None) == "missed"


def scenes() -> list[Any]:
    return [replace(scenarios.case(number).scenario, rubber=Rubber()) for number in range(3)]


def test_a_salt_gives_the_same_scenes_and_another_one_others(monkeypatch):
    found = {}
    for word in ("", "kestrel", "kestrel", "heron"):
        monkeypatch.setenv(salt._VARIABLE, word)
        drawn = scenes(), salt.seed(3)
        assert repr(found.setdefault(word, drawn)) == repr(drawn)
    assert found[""][1] == 3
    for drawn in zip(*found.values(), strict=True):  # scenes, then the benches' own seeds
        assert len({repr(one) for one in drawn}) == 3


def test_of_held_out_scenes_only_totals_are_given(tmp_path, monkeypatch):
    monkeypatch.setenv(salt._VARIABLE, "")

    @benchmark("planted", "A planted figure.", salt.salt_option)
    def command(quick: bool) -> Report:
        return Report(
            salt.held_out(), [Figure("sum", "3")], [("scene",), ("two balls",)], {"scene": "two balls"}
        )

    summary = tmp_path / "planted.json"
    for words, shown in (("--summary", True), ("--held-out kestrel --summary", False)):
        out = run(words, summary, command=command).out
        assert ("two balls" in out, "two balls" in summary.read_text()) == (shown, shown)
        assert ("kestrel" in out) is not shown


@pytest.mark.parametrize("statistic", [np.median, np.mean])
def test_the_standard_error_is_that_of_the_figure(statistic):
    draw = np.random.default_rng(1)
    figures = [statistic(draw.normal(size=80)) for _ in range(400)]
    stated = np.mean([estimate(statistic, draw.normal(size=80))[1] for _ in range(20)])
    # the scatter of 400 figures is known to 4 %; the bootstrap of a median is some percent large
    assert stated == pytest.approx(np.std(figures), rel=0.15)


def test_a_rate_of_nothing_seen_is_not_known_exactly():
    share, error = rate(0, 100)
    # Poisson: none of 100 is as likely as not up to 0.7 %
    assert share == 0
    assert 0.003 < error < 0.01
    assert rate(50, 100)[1] == pytest.approx(0.05, rel=0.01)
