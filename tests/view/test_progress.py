"""How far something is, where there is no terminal."""

from zeromethod.view import progress


def test_without_a_terminal_a_plain_line_says_how_far_it_is(monkeypatch, capsys):
    monkeypatch.setattr(progress, "EVERY_S", 0.0)
    with progress.progress(3, "presses") as advance:
        advance()
        advance("")
    assert capsys.readouterr().err.splitlines() == ["presses: 1 of 3", "presses: 2 of 3"]


def test_what_is_soon_done_says_nothing_without_a_terminal(monkeypatch, capsys):
    monkeypatch.setattr(progress, "EVERY_S", 60.0)
    with progress.progress(1, "presses") as advance:
        advance()
    assert capsys.readouterr().err == ""
