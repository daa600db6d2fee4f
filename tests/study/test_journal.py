"""Runs that are done stay done, whatever ends the study."""

import json
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import pyarrow.parquet
import pytest

from zeromethod.errors import InputError
from zeromethod.resources import resource
from zeromethod.study import Study, Task, parse_study, run_study
from zeromethod.study.journal import JOURNAL
from zeromethod.study.results import COPY, TABLE
from zeromethod.study.runs import carry_out

Squares = Callable[..., Study]


class Here:
    """Carries out runs in this process, so many at most; notes which."""

    def __init__(self, most: int = 1000) -> None:
        self.most = most
        self.runs: list[int] = []

    def outcomes(self, tasks: Sequence[Task]) -> Iterator[dict[str, Any]]:
        for task in tasks[: self.most]:
            self.runs.append(task.run)
            yield carry_out(task)
        if len(tasks) > self.most:
            raise KeyboardInterrupt


def test_an_interrupted_study_goes_on_where_it_stood(squares, tmp_path):
    whole = run_study(squares(), tmp_path / "whole", Here())
    with pytest.raises(KeyboardInterrupt):
        run_study(squares(), tmp_path / "cut", Here(most=2))
    rest = Here()
    results = run_study(squares(), tmp_path / "cut", rest)
    assert rest.runs == [2, 3, 4, 5]
    assert results.before == 2
    assert results.rows == whole.rows
    assert (tmp_path / "cut" / TABLE).read_bytes() == (tmp_path / "whole" / TABLE).read_bytes()


def test_a_line_cut_off_by_a_crash_is_done_again(squares, tmp_path):
    run_study(squares(), tmp_path, Here())
    journal = tmp_path / JOURNAL
    journal.write_bytes(journal.read_bytes()[:-20])
    last = Here()
    run_study(squares(), tmp_path, last)
    assert last.runs == [5]
    assert [json.loads(line)["run"] for line in journal.read_text().splitlines()[1:]] == list(range(6))


@pytest.mark.parametrize("damage", ['{"run": 3, "tr', '{"run": 3}', "[]", "\0\0\0"])
def test_a_damaged_line_costs_only_its_own_run(squares, tmp_path, damage):
    whole = run_study(squares(), tmp_path / "whole", Here())
    run_study(squares(), tmp_path / "a", Here())
    journal = tmp_path / "a" / JOURNAL
    lines = journal.read_text().splitlines()
    journal.write_text("\n".join([*lines[:4], damage, *lines[5:]]) + "\n")
    reported: list[str] = []
    again = Here()
    results = run_study(squares(), tmp_path / "a", again, report=reported.append)
    assert again.runs == [3]
    assert reported == [f"{journal}: damaged at line 5: left out; what is missing is done again"]
    assert (results.before, results.rows) == (5, whole.rows)
    # once is enough
    run_study(squares(), tmp_path / "a", Here(), report=reported.append)
    assert len(reported) == 1
    assert sorted(path.name for path in (tmp_path / "a").iterdir()) == sorted(
        path.name for path in (tmp_path / "whole").iterdir()
    )


def test_a_line_of_rubbish_at_the_end_costs_nothing(squares, tmp_path):
    run_study(squares(), tmp_path, Here())
    with (tmp_path / JOURNAL).open("a") as journal:
        journal.write('{"run": 3, "tr\n')
    again = Here()
    assert run_study(squares(), tmp_path, again).before == 6
    assert again.runs == []


def test_a_damaged_head_is_reported(squares, tmp_path):
    run_study(squares(), tmp_path, Here())
    journal = tmp_path / JOURNAL
    journal.write_text("x" + journal.read_text())
    with pytest.raises(InputError, match="line 1, which says what study it is of, is damaged"):
        run_study(squares(), tmp_path, Here())


def test_another_limit_does_not_make_another_study(squares, tmp_path):
    run_study(squares(), tmp_path, Here())
    assert run_study(squares(limit_s=9.0), tmp_path, Here()).before == 6


@pytest.mark.parametrize(
    ("count", "setting", "seed", "reported"),
    [
        (6, '"control.gain" = 0.5', 3, "with other settings, rig or seed"),
        (6, "", 4, "with other settings, rig or seed"),
        (7, "", 3, "is of 6 runs, the file now has 7"),
    ],
)
def test_other_settings_do_not_get_mixed_in(squares, tmp_path, count, setting, seed, reported):
    run_study(squares(), tmp_path, Here())
    changed = squares(count, setting, seed=seed)
    with pytest.raises(InputError, match=reported):
        run_study(changed, tmp_path, Here())
    restarted = Here()
    assert run_study(changed, tmp_path, restarted, restart=True).before == 0
    assert len(restarted.runs) == count


@pytest.mark.parametrize("rest", ["", '{"run": 0, "se'])
def test_a_folder_without_a_finished_run_is_free(squares, tmp_path, rest):
    with pytest.raises(KeyboardInterrupt):
        run_study(squares(), tmp_path, Here(most=0))
    with (tmp_path / JOURNAL).open("a") as journal:
        journal.write(rest)
    changed = squares(4, seed=9)
    results = run_study(changed, tmp_path, Here())
    assert (results.before, len(results.rows)) == (0, 4)
    assert (tmp_path / COPY).read_text() == changed.text
    again = Here()
    assert run_study(changed, tmp_path, again).before == 4
    assert again.runs == []


def test_a_file_of_something_else_is_not_overwritten(squares, tmp_path):
    (tmp_path / JOURNAL).write_text('{"of": "another program"}\n')
    with pytest.raises(InputError, match="was written by a version that kept its runs otherwise"):
        run_study(squares(), tmp_path, Here())
    assert (tmp_path / JOURNAL).read_text() == '{"of": "another program"}\n'


def test_a_changed_rig_file_counts_as_other_settings(squares, tmp_path):
    rig = tmp_path / "mine.toml"
    text = resource("calibration", "rigs", "simulated.toml").read_text()
    rig.write_text(text)
    assert "gain = 1.0" in text
    run_study(squares(3, '"rig.file" = "mine.toml"'), tmp_path / "out", Here())
    rig.write_text(text.replace("gain = 1.0", "gain = 0.9"))
    with pytest.raises(InputError, match="with other settings, rig or seed"):
        run_study(squares(3, '"rig.file" = "mine.toml"'), tmp_path / "out", Here())


def test_another_versions_runs_are_refused(squares, tmp_path):
    run_study(squares(), tmp_path, Here())
    journal = tmp_path / JOURNAL
    head, *rest = journal.read_text().splitlines()
    said = json.loads(head)
    said["study"]["zeromethod"] = "0.0.1"
    journal.write_text("\n".join([json.dumps(said), *rest]) + "\n")
    with pytest.raises(InputError, match=r"was begun by zeromethod 0\.0\.1"):
        run_study(squares(), tmp_path, Here())


def test_two_studies_do_not_share_a_folder(squares, tmp_path):
    class Twice(Here):
        def outcomes(self, tasks: Sequence[Task]) -> Iterator[dict[str, Any]]:
            with pytest.raises(InputError, match="a study is being run there"):
                run_study(squares(), tmp_path, Here())
            return super().outcomes(tasks)

    assert len(run_study(squares(), tmp_path, Twice()).rows) == 6


def test_failed_runs_are_done_again_only_when_asked(squares, tmp_path):
    results = run_study(squares(6, "fails_at = 4"), tmp_path, Here())
    assert [(row["run"], row["failure"]) for row in results.failures] == [(4, "no 4")]
    kept, again = Here(), Here()
    run_study(squares(6, "fails_at = 4"), tmp_path, kept)
    run_study(squares(6, "fails_at = 4"), tmp_path, again, retry_failed=True)
    assert kept.runs == []
    assert again.runs == [4]


def test_whole_numbers_without_bound_do_not_lose_the_table(squares, tmp_path):
    big = 2**62
    study = squares(2, f"fails_at = {big}")
    study = parse_study(study.text.replace("x = [0, 1]", f"x = [2, {10**10}, {big}]"), study.path)
    run_study(study, tmp_path, Here())
    table = pyarrow.parquet.read_table(tmp_path / TABLE)
    assert table["square"].to_pylist() == [4, 1e20, None]
    assert table["x"].to_pylist() == [2, 10**10, big]


def test_the_table_says_what_its_columns_mean(squares, tmp_path):
    study = squares(3, "fails_at = 1")
    run_study(study, tmp_path, Here())
    table = pyarrow.parquet.read_table(tmp_path / TABLE)
    assert table.column_names == ["run", "repeat", "seed", "x", "square", "gain", "seed_of_bench", "failure"]
    assert table["square"].to_pylist() == [0, None, 4]
    assert table["failure"].to_pylist() == [None, "no 1", None]
    assert table.schema.field("square").metadata == {b"meaning": b"x times x"}
    assert table.schema.metadata[b"study"].decode() == study.text
