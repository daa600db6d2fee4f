"""A session as one HDF5 file: written by a process next to the loop, readable by any HDF5 program.

    from zeromethod.recording import Recording

Names are loaded on first use: the process that writes needs few.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
