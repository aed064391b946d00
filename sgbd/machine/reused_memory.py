"""Memory that is reused from call to call."""

from __future__ import annotations

import threading
from typing import Any

import numpy as np
import numpy.typing as npt

_memory = threading.local()


def reused(role: str, shape: tuple[int, ...], dtype: type) -> npt.NDArray[Any]:
    """Return an array as work space, the same one in every call from this thread as long as the shape stays the same.

    The system provides large fresh memory page by page, which takes as long as the computation in it.

    Args:
        role: Purpose of the array; two arrays in use at the same time need different roles.
        shape: Its shape.
        dtype: Its type.

    Returns:
        The array, uninitialised.
    """
    array: npt.NDArray[Any] | None = getattr(_memory, role, None)
    if array is None or array.shape != shape:
        array = np.empty(shape, dtype)
        setattr(_memory, role, array)
    return array
