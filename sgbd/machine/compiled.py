"""Compilation of the loops over pixels, superpixels and edges.

Functions that NumPy can't express without temporary arrays are written as plain loops and decorated with `compiled`.
With Numba they become machine code that releases the interpreter lock; without it the same source runs as Python,
slowly but with the same result.

Compiling takes most of the time of the first frame on a machine, so the functions are written to compile quickly. The
caller allocates arrays. Numbers that pass between functions have one type: ``np.int64(0)``, because a literal 0 has a
type of its own, for which the called function would be compiled a second time. Rows are sliced once instead of being
indexed again and again.

Arrays that belong together can be passed as a `typing.NamedTuple`. This is not free: every call updates the reference
count of each array in it, so small functions that take one are compiled with ``inline="always"``.
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from typing import Any, TypeVar, overload

try:
    import numba
    from numba.core import event
except ImportError:
    numba = event = None

logger = logging.getLogger(__name__)

HAS_NUMBA: bool = numba is not None
"""Whether decorated functions run as machine code."""

Function = TypeVar("Function", bound=Callable[..., Any])

if not HAS_NUMBA:
    logger.warning(
        "numba is not installed: the loops over pixels and edges run as plain Python, which is many times slower. "
        "Install it with 'pip install numba'."
    )


@overload
def compiled(function: Function, /) -> Function: ...
@overload
def compiled(**options: Any) -> Callable[[Function], Function]: ...
def compiled(function: Function | None = None, /, **options: Any) -> Function | Callable[[Function], Function]:
    """Compile a function on its first call, and keep the machine code on disk for later processes.

    Use it bare (``@compiled``) or with options of `numba.njit` (``@compiled(fastmath=True)``). The code is kept where
    Numba can write: beside the source, else in the user's cache folder (``NUMBA_CACHE_DIR`` overrides it). If no folder
    is writable, as in a read-only container, the function is compiled once per process.

    Args:
        function: A function of arrays and numbers, in the subset of Python that Numba supports.
        **options: Further options of `numba.njit`; ``cache`` and ``nogil`` are on unless given.

    Returns:
        The compiled function, or `function` itself if Numba is not installed.
    """
    if function is None:
        return lambda decorated: _compile(decorated, options)
    return _compile(function, options)


def _compile(function: Function, options: dict[str, Any]) -> Function:
    if numba is None:
        return function
    # Nothing calls the functions from C, so don't compile the C entry point that Numba adds to each.
    kept, options = options.get("cache", True), {"nogil": True, "no_cfunc_wrapper": True, **options, "cache": False}
    dispatcher: Function = numba.njit(**options)(function)
    if kept and dispatcher is not function:  # with NUMBA_DISABLE_JIT, for a debugger, it is the function itself
        from sgbd.machine.kept_code import keep_on_disk

        try:
            keep_on_disk(dispatcher)
        except RuntimeError as error:  # raised by Numba if it finds no writable folder
            if "cannot cache function" not in str(error):
                raise
            logger.info("no writable folder for compiled code: %s is compiled in every process", function.__qualname__)
    return dispatcher


def _announce_first_compilation() -> None:
    """Log once per process that loops are being compiled; reading kept code from disk logs nothing."""

    class Announcement(event.Listener):
        told = False

        def on_start(self, compilation: Any) -> None:
            if not self.told and compilation.data["dispatcher"].__module__.startswith("sgbd."):
                self.told = True
                logger.info(
                    "compiling loops, once on this machine: it takes half a minute or less, longer on a busy processor"
                )

        def on_end(self, compilation: Any) -> None:
            """Log nothing."""

    event.register("numba:compile", Announcement())


if HAS_NUMBA:
    _announce_first_compilation()
