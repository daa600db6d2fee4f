"""The attributes of a recording's root: what wrote it, how, and of which rig."""

from __future__ import annotations

from typing import Any

from zeromethod.recording.checksums import canonical, checksum_of
from zeromethod.recording.columns import LATER, TABLES
from zeromethod.recording.opening import Refusal, RefusedRecording
from zeromethod.recording.schema import LIGHT_ARRAYS, SCHEMA, SCHEMA_VERSION
from zeromethod.recording.source import RecordingFile


def checked_attributes(source: RecordingFile) -> dict[str, Any]:
    """All of them. Raises RefusedRecording for no recording, another format, damage, an empty file."""
    found = source.attributes()
    if found.get("format") == LIGHT_ARRAYS:
        raise RefusedRecording(source.path, Refusal.LIGHT_ARRAYS)
    if found.get("schema") != SCHEMA:
        raise RefusedRecording(source.path, Refusal.NO_RECORDING)
    if (version := found.get("schema_version")) != SCHEMA_VERSION:
        by = found.get("zeromethod_version", "of an unknown version")
        details = {"found": version, "reads": SCHEMA_VERSION, "by": by}
        raise RefusedRecording(source.path, Refusal.OTHER_FORMAT, **details)
    # it is the last of them to be written
    tables = (f"{name}/table" for name in TABLES if name not in LATER)
    if "checksum" not in found or not source.names.issuperset(("rest", *tables)):
        raise RefusedRecording(source.path, Refusal.EMPTY)
    if int(found["checksum"]) != checksum_of(canonical(found)):
        raise RefusedRecording(source.path, Refusal.CHANGED, part="its attributes (rig, calibration, ...)")
    return found
