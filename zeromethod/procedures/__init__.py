"""What a person asks of a bench: a run, its figures, its errors against a planted truth."""

from zeromethod.procedures.result import FrameRecord, RunResult, Snapshot
from zeromethod.procedures.run import Run, run
from zeromethod.procedures.summary import summarise

__all__ = ["FrameRecord", "Run", "RunResult", "Snapshot", "run", "summarise"]
