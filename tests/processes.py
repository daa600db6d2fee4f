"""Processes that are nobody's children here."""

from pathlib import Path


def has_ended(process_id: int) -> bool:
    """Whether a process has; one that nobody waited for stays on as a name."""
    try:
        return Path(f"/proc/{process_id}/stat").read_text().rpartition(")")[2].split()[0] in "ZX"
    except (FileNotFoundError, ProcessLookupError):
        return True
