"""What a person runs: the loop with its readings, figures, errors against a planted truth, and replay.

Names are loaded on first use: the processes that read surfaces need few.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
