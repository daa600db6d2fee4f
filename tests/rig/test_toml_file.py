"""Files that are no TOML of a person's: too deep, too large, without end, with a mark in front."""

import os
from pathlib import Path

import pytest

from zeromethod.errors import InputError
from zeromethod.toml_file import MOST_BYTES, MOST_DEPTH, parse_toml, read_text


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("a = " + "[" * 900 + "]" * 900, "32 at most"),
        ("a = " + "{b = " * 900 + "1" + "}" * 900, "32 at most"),
        ("a = " + "[" * MOST_DEPTH + "]" * MOST_DEPTH, "x.toml: a: tables or lists inside each other"),
        # the parser would take an hour
        ("\n" + "a." * 500_000 + "a = 1", "line 2: tables or lists inside each other: 32 at most"),
        ("a = " + "1" * 5000, "whole numbers of TOML have 64 bits"),
        ("[t]\na = 9223372036854775808", "x.toml: a: too large: whole numbers of TOML have 64 bits"),
        ("a = 0x" + "f" * 5000, "whole numbers of TOML have 64 bits"),
    ],
    ids=["lists", "tables", "just too deep", "key", "digits", "65 bits", "hexadecimal"],
)
def test_what_is_too_deep_or_too_large_is_refused_in_one_line(text, words):
    with pytest.raises(InputError) as caught:
        parse_toml(text, "x.toml")
    assert words in str(caught.value)
    assert len(str(caught.value).splitlines()[0]) == len(str(caught.value)) < 200


def test_what_is_just_allowed_is_read():
    inside = "[" * (MOST_DEPTH - 1) + "]" * (MOST_DEPTH - 1)
    assert parse_toml(f"a = {inside}\nb = -9223372036854775808", "x.toml")["b"] == -(2**63)


def test_only_ordinary_files_of_bounded_size_are_read(tmp_path):
    pipe, large, missing = tmp_path / "pipe", tmp_path / "large", tmp_path / "missing"
    os.mkfifo(pipe)
    large.write_bytes(b"\n" * (MOST_BYTES + 1))
    refused = {
        Path("/dev/zero"): "not an ordinary file",
        pipe: "not an ordinary file",
        tmp_path: "not an ordinary file",
        large: "more than 1 MiB",
        missing: "cannot be read: No such file or directory",
    }
    for path, words in refused.items():
        with pytest.raises(InputError) as caught:
            read_text(path, "a rig file")
        assert str(caught.value) == f"{path}: {words}: a rig file"


def test_a_byte_order_mark_is_skipped(tmp_path):
    (tmp_path / "a.toml").write_bytes(b"\xef\xbb\xbfname = 1\r\n")
    assert read_text(tmp_path / "a.toml", "") == "name = 1\r\n"
