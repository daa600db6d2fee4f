"""Closed-loop deflectometry: null a deforming mirror's reflection, read its shape off the warp.

    import zeromethod as zm

    with zm.Session("simulated") as session:
        for step in session.run(seconds=1.0):
            print(step.state, step.peak)

All names are listed in `__init__.pyi` and loaded on first use, so that importing the package costs nothing.
"""

import lazy_loader

_lazy, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
__all__ += ["__version__"]


def __getattr__(name: str) -> object:
    """Load a name on first use; the version, too: looking it up takes longer than all else here."""
    if name == "__version__":
        from importlib.metadata import version  # noqa: PLC0415

        return version("zeromethod")
    return _lazy(name)
