"""Who may fill a monitor."""

import pytest

from zeromethod.drivers.claim import Claim, claim_monitor


def test_a_name_is_held_once_and_free_after_its_release() -> None:
    first = Claim("a test")
    with pytest.raises(FileExistsError, match="a test: in use"):
        Claim("a test")
    first.release()
    first.release()
    Claim("a test").release()


def test_monitors_and_desktops_are_told_apart(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    monkeypatch.setenv("DISPLAY", ":4711")
    first, second = claim_monitor(0), claim_monitor(1)
    monkeypatch.setenv("DISPLAY", ":4712")
    third = claim_monitor(0)
    for claim in (first, second, third):
        claim.release()
