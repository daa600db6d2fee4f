"""The list of planted faults fits the tree."""

from tools.mutants import ROOT, Mutant, mutants, unfit


def test_each_of_twenty_faults_can_be_planted_once():
    listed = mutants()
    assert len({one.name for one in listed}) == len(listed) == 20
    assert unfit(listed) == []
    assert all(one.new != one.old for one in listed)


def test_what_simulates_the_bench_is_left_alone():
    assert not [one.file for one in mutants() if one.file.startswith("zeromethod/simulation/")]


def test_a_fault_that_does_not_fit_is_named_in_one_line_for_each_reason():
    never, often = (
        Mutant("a", "tools/mutants.py", "not in " + "this file", "", ["tests/tools"]),
        Mutant("b", "tools/mutants.py", "return", "", ["tests/no_such_folder"]),
    )
    lines = unfit([never, often], ROOT)
    assert len(lines) == 3
    assert "is in it 0 times" in lines[0]
    assert lines[2] == "mutants: b: tests/no_such_folder: there is no such test"
