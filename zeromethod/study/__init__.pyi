from .plan import Study, load_study, packaged_studies, parse_study
from .results import Progress, Results, run_study
from .task import Procedure, Task
from .workers import Workers

__all__ = [
    "Procedure",
    "Progress",
    "Results",
    "Study",
    "Task",
    "Workers",
    "load_study",
    "packaged_studies",
    "parse_study",
    "run_study",
]
