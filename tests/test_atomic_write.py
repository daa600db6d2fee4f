"""Files replaced in one step."""

import os
from pathlib import Path

import pytest

from zeromethod.atomic_write import atomic_write


def write_half(path: Path) -> None:
    with atomic_write(path) as part:
        part.write_text("half")
        raise KeyboardInterrupt


def test_writing_that_ends_early_leaves_the_old_file_and_nothing_else(tmp_path):
    path = tmp_path / "a.npz"
    path.write_text("old")
    with pytest.raises(KeyboardInterrupt):
        write_half(path)
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]
    with atomic_write(path) as part:
        part.write_text("new")
    assert path.read_text() == "new"
    assert list(tmp_path.iterdir()) == [path]


def test_permissions_and_links_are_kept(tmp_path):
    path, link = tmp_path / "file", tmp_path / "link"
    path.write_text("old")
    path.chmod(0o640)
    link.symlink_to(path)
    with atomic_write(link) as part:
        part.write_text("new")
    assert link.is_symlink()
    assert path.read_text() == "new"
    assert path.stat().st_mode & 0o777 == 0o640


def test_a_new_file_has_the_permissions_of_any_new_file(tmp_path):
    (tmp_path / "plain").touch()
    with atomic_write(tmp_path / "new") as part:
        part.touch()
    assert (tmp_path / "new").stat().st_mode == (tmp_path / "plain").stat().st_mode


def test_two_that_write_at_once_do_not_mix(tmp_path):
    path = tmp_path / "file"
    with atomic_write(path) as first, atomic_write(path) as second:
        first.write_text("first")
        second.write_text("second")
    assert path.read_text() == "first"  # the outer block ends last
    assert list(tmp_path.iterdir()) == [path]


def test_the_content_is_on_the_disk_before_the_file_is_replaced(tmp_path, monkeypatch):
    path = tmp_path / "file"
    synced: list[bool] = []
    monkeypatch.setattr(
        "os.fsync", lambda handle: synced.append(not path.exists() and os.fstat(handle).st_size == 3)
    )
    with atomic_write(path) as part:
        part.write_text("new")
    assert synced == [True]
