"""A session as one HDF5 file, written alongside the running loop and read by anyone.

    from zeromethod.recording import Recording

Names are loaded on first use: the process that writes needs few of them.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
