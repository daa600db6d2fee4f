"""Many runs: a grid or a Monte Carlo over settings, on every core or a Dask cluster, to one table.

study = load_study("gain-delay")
results = run_study(study, Path("gain-delay"), Workers())
"""

from zeromethod.study.plan import Study, load_study, packaged_studies, parse_study
from zeromethod.study.results import Progress, Results, run_study
from zeromethod.study.task import Procedure, Task
from zeromethod.study.workers import Workers

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
