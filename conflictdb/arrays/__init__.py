"""Represent objects, pieces, pairs and answers as arrays, which the stages exchange."""

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
