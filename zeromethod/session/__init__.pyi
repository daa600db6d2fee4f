from .result import RunResult
from .session import Session
from .summary import summarise
from .whole_run import run

__all__ = ["RunResult", "Session", "run", "summarise"]
