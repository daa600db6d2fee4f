"""Every benchmark as a person meets it: --help with an example, bad input in one line."""

import importlib
from pathlib import Path

import pytest

import benchmarks
from benchmarks.report import Figure, Report, benchmark, start

HELPERS = {"report", "rigs", "live_running", "memory_devices"}
FILES = Path(str(benchmarks.__file__)).parent.glob("*.py")
NAMES = sorted({file.stem for file in FILES} - HELPERS - {"__init__"})


def outcome(
    name: str, *arguments: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> tuple[int, str, str]:
    command = importlib.import_module(f"benchmarks.{name}").command
    monkeypatch.setattr("sys.argv", [name, *arguments])
    with pytest.raises(SystemExit) as end:
        start(command)
    printed = capsys.readouterr()
    return int(end.value.code or 0), printed.out, printed.err


@pytest.mark.parametrize("name", NAMES)
def test_help_says_what_it_measures_with_an_example(
    name: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    code, out, err = outcome(name, "--help", monkeypatch=monkeypatch, capsys=capsys)
    assert (code, err) == (0, "")
    assert f"Usage: python -m benchmarks.{name} " in out
    assert f"Example: python -m benchmarks.{name} " in out
    assert "[--" not in out


@pytest.mark.parametrize(
    ("name", "arguments", "word"),
    [
        *((name, ["--colour"], "--colour") for name in NAMES),
        ("sigma", ["--summary", "sigma.txt"], "must end in .json"),
        ("sigma", ["--summary", "no/such/folder/s.json"], "does not exist"),
        ("calibration_benches", ["--benches", "0"], "--benches: 0: a whole number from 1"),
        ("recording_cost", ["--keep", "sound"], "--keep: 'sound'"),
        ("recording_cost", ["--folder", "no/such/folder"], "--folder"),
        ("window_speed", ["--pictures", "many"], "--pictures: many: a whole number from 2"),
    ],
)
def test_bad_input_is_one_line_and_exit_code_2(
    name: str,
    arguments: list[str],
    word: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    code, out, err = outcome(name, *arguments, monkeypatch=monkeypatch, capsys=capsys)
    assert (code, out, err.count("\n")) == (2, "", 1)
    assert word in err


@pytest.mark.parametrize(("met", "code"), [(True, 0), (None, 0), (False, 1)])
def test_a_figure_that_misses_its_bar_makes_the_exit_code_1(
    met: bool | None,
    code: int,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    @benchmark("planted", "A planted figure.")
    def command(quick: bool) -> Report:
        assert quick
        return Report(
            "title", [Figure("error", "0.3 %", "<= 1 %", met)], [("case", "n"), ("a", "1")], {"n": 1}
        )

    summary = tmp_path / "planted.json"
    monkeypatch.setattr("sys.argv", ["planted", "--quick", "--summary", str(summary)])
    with pytest.raises(SystemExit) as end:
        start(command)
    assert (end.value.code or 0) == code
    out = capsys.readouterr().out
    assert "0.3 %" in out
    assert ("MISSED" in out) is (met is False)
    assert '"met": ' in summary.read_text()
