"""What a person runs: the loop with its readings, figures, errors against a planted truth, and replay."""

from zeromethod.session.result import RunResult
from zeromethod.session.session import Session
from zeromethod.session.summary import summarise
from zeromethod.session.whole_run import run

__all__ = ["RunResult", "Session", "run", "summarise"]
