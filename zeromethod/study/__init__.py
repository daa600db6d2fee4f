"""Many runs: a grid or a Monte Carlo over settings, on every core or a Dask cluster, to one table.

study = load_study("gain-delay")
results = conduct(study, Path("gain-delay"), LocalPool())
"""

from zeromethod.study.cluster import Cluster
from zeromethod.study.conduct import Results, Standing, conduct
from zeromethod.study.plan import Study, load_study, packaged_studies, parse_study
from zeromethod.study.pool import LocalPool
from zeromethod.study.task import Procedure, Task

__all__ = [
    "Cluster",
    "LocalPool",
    "Procedure",
    "Results",
    "Standing",
    "Study",
    "Task",
    "conduct",
    "load_study",
    "packaged_studies",
    "parse_study",
]
