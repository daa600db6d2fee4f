"""What others wrote is exactly what they published, with its licences, and nothing else."""

import hashlib
from importlib.resources import files
from pathlib import Path

VENDOR = Path(str(files("zeromethod.page").joinpath("vendor")))
LICENCES = {"three.LICENSE", "uPlot.LICENSE"}


def test_the_files_of_others_are_those_of_the_checksums():
    sums = dict(reversed(line.split()) for line in (VENDOR / "SHA256SUMS").read_text().splitlines())
    assert {one.name for one in VENDOR.iterdir()} == {*sums, *LICENCES, "SHA256SUMS"}
    for name, wanted in sums.items():
        assert hashlib.sha256((VENDOR / name).read_bytes()).hexdigest() == wanted, name
    for name in LICENCES:
        assert "Permission is hereby granted, free of charge" in (VENDOR / name).read_text()
