"""What a person runs: the loop with its readings, figures, errors against a planted truth, and replay."""

from zeromethod.session.result import RunResult
from zeromethod.session.session import Session, run
from zeromethod.session.summary import summarise

__all__ = ["RunResult", "Session", "run", "summarise"]
