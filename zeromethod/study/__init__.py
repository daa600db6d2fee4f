"""Many runs: a grid or a Monte Carlo over settings, on every core or a Dask cluster, to one table.

study = load_study("gain-delay")
results = run_study(study, Path("gain-delay"), Workers())
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
