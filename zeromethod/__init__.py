"""Closed-loop deflectometry: null a deforming mirror's reflection, read its shape off the warp.

    import zeromethod as zm

    with zm.Session("simulated") as session:
        for step in session.run(seconds=1.0):
            print(step.state, step.peak)

All names are listed in `__init__.pyi` and loaded on first use, so that importing the package costs nothing.
"""

from importlib.metadata import version

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
__version__ = version("zeromethod")
__all__ += ["__version__"]
