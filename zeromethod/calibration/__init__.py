"""From an unknown bench to millimetres: geometry fitted to all that is known, with what remains unknown.

priors = Priors.of(rig)
reading = RestReading.of(grid, rest)
fitted = fit(priors, [RestPositions.of(grid, rest), Presses.of(reading, [press])])
error = depth_error(fitted, grid, reading)
verdict = judge(fitted, error, gains(fitted, error))
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
