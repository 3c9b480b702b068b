"""Types of numpy arrays."""

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray
else:
    # Annotations need no more than the class. To import numpy.typing takes 5 ms, a thirtieth of the start.
    ArrayLike = object
    NDArray = np.ndarray

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

__all__ = ["ArrayLike", "BoolArray", "FloatArray", "IntArray", "NDArray"]
