"""What a person runs: the loop with its readings, figures, errors against a planted truth, and replay."""

from zeromethod.session.result import FrameRecord, RunResult, Snapshot
from zeromethod.session.run import Run, run
from zeromethod.session.summary import summarise

__all__ = ["FrameRecord", "Run", "RunResult", "Snapshot", "run", "summarise"]
