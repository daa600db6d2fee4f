"""Every benchmark as a person meets it: --help with an example, exit codes, what it writes."""

import json

import pytest
from command_line import run

from benchmarks import against_peers as bench
from benchmarks.against_peers import __main__ as against_peers
from benchmarks.parts import Parts
from benchmarks.report import Figure, Report, benchmark, start
from zeromethod.errors import InputError


@pytest.mark.parametrize(("met", "code"), [(True, 0), (None, 0), (False, 1)])
def test_a_figure_that_misses_its_bar_makes_the_exit_code_1(met, code, tmp_path, monkeypatch, capsys):
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


def test_a_benchmark_in_parts_goes_on_from_what_it_kept(tmp_path):
    kept, ran = tmp_path / "kept.jsonl", []

    def one(number: int) -> dict[str, int]:
        ran.append(number)
        return {"squared": number**2}

    assert Parts(kept, 2, presses=4).run(4, "runs", one) == [{"squared": 0}, {"squared": 1}]
    assert [one["squared"] for one in Parts(kept, None, presses=4).run(4, "runs", one)] == [0, 1, 4, 9]
    assert ran == [0, 1, 2, 3]
    with pytest.raises(InputError, match="made by other code or settings"):
        Parts(kept, None, presses=5)


def test_displacement_is_measured_next_to_its_peers_and_written(tmp_path):
    figure, summary = tmp_path / "bench.png", tmp_path / "bench.json"
    line = "--quick --part displacement --figure"
    code, out, err = run(line, figure, "--summary", summary, command=against_peers.command)
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


def test_ctrl_c_keeps_what_is_measured_so_far(tmp_path, monkeypatch):
    def interrupted(figures: dict, on_step: object, quick: bool) -> None:
        figures["methods"] = {}
        raise KeyboardInterrupt

    monkeypatch.setitem(bench.PARTS, "scaling", bench.Part(lambda quick: 1, interrupted))
    summary = tmp_path / "bench.json"
    line = "--quick --part integration --part scaling --summary"
    code, out, _ = run(line, summary, command=against_peers.command)
    assert code == 130
    assert "cosine transform" in out
    figures = json.loads(summary.read_text())
    assert figures["integration"]["methods"]["cosine transform"]["regular"]["error_percent"] < 0.1
