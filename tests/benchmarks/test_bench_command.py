"""`python -m benchmarks.against_peers` as a person meets it: what it writes, how it refuses, how it ends."""

import json
from pathlib import Path

import pytest

from benchmarks import against_peers as bench
from benchmarks.against_peers.__main__ import command
from zeromethod.cli.main import main


def outcome(*arguments: object, capsys: pytest.CaptureFixture[str]) -> tuple[int, str, str]:
    with pytest.raises(SystemExit) as end:
        main([str(argument) for argument in arguments], command, "benchmarks.against_peers")
    printed = capsys.readouterr()
    return int(end.value.code or 0), printed.out, printed.err


def test_displacement_is_measured_beside_the_peers_and_written(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    figure, summary = tmp_path / "bench.png", tmp_path / "bench.json"
    code, out, err = outcome(
        "--quick", "--part", "displacement", "--figure", figure, "--summary", summary, capsys=capsys
    )
    assert (code, err) == (0, "")
    assert "noise/bound" in out
    figures = json.loads(summary.read_text())
    assert set(figures["host"]) >= {"cores", "opencv", "versions", "threads"}
    methods = figures["displacement"]["methods"]
    # Half a thousand nodes over few rounds: the bar of 1.1 widened by what that leaves unknown.
    assert methods["residual (this system)"]["noise_of_bound"] < 1.15
    for name in ("phase shifting, 4 steps", "phase shifting, 8 steps"):
        assert methods[name]["noise_of_bound"] == pytest.approx(1.0, abs=0.03)
    for found in methods.values():
        assert found["null"]["ms"]["median"] > 0
    assert figure.read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--part", "everything"], ["everything", "displacement", "why"]),
        (["--figure", "bench.jpeg"], ["--figure", ".png"]),
        (["--summary", "no/such/folder/bench.json"], ["--summary", "does not exist"]),
        (["--fast"], ["--fast"]),
    ],
)
def test_bad_input_is_one_line_and_exit_code_2(
    arguments: list[str], words: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    code, _, err = outcome(*arguments, capsys=capsys)
    assert code == 2
    assert err.count("\n") == 1
    for word in words:
        assert word in err


def test_ctrl_c_keeps_what_is_measured_so_far(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted(figures: dict, on_step: object, quick: bool) -> None:
        figures["methods"] = {}
        raise KeyboardInterrupt

    monkeypatch.setitem(bench.PARTS, "scaling", bench.Part(lambda quick: 1, interrupted))
    summary = tmp_path / "bench.json"
    code, out, _ = outcome(
        "--quick", "--part", "integration", "--part", "scaling", "--summary", summary, capsys=capsys
    )
    assert code == 130
    assert "cosine transform" in out
    figures = json.loads(summary.read_text())
    assert figures["integration"]["methods"]["cosine transform"]["regular"]["error_percent"] < 0.1
