"""Names of array types, as signatures use them; shapes and units stand in the docstrings."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

Float = NDArray[np.float64]
Single = NDArray[np.float32]
Mask = NDArray[np.bool_]
Flags = NDArray[np.uint16]
Ints = NDArray[np.int64]
Bytes = NDArray[np.uint8]

Image = NDArray[Any]
"""Grey levels as a camera gives them, uint8 or uint16, or arrays of any type."""
