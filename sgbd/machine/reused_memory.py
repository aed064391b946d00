"""Memory that is kept from call to call."""

from __future__ import annotations

import threading
from typing import Any

import numpy as np
import numpy.typing as npt

_memory = threading.local()


def reused(role: str, shape: tuple[int, ...], dtype: type) -> npt.NDArray[Any]:
    """Return an array to work in, the same one in every call from this thread as long as the shape stays.

    Fresh memory of some size comes from the system page by page, which takes as long as what is computed in it.

    Args:
        role: What the array is for: no two in use at a time share one.
        shape: Its shape.
        dtype: Its type.

    Returns:
        The array, with anything in it.
    """
    array: npt.NDArray[Any] | None = getattr(_memory, role, None)
    if array is None or array.shape != shape:
        array = np.empty(shape, dtype)
        setattr(_memory, role, array)
    return array
