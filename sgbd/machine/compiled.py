"""Compilation of the loops over pixels, superpixels and edges.

The functions that NumPy can't express without temporary arrays are written as plain loops and decorated with
`compiled`. With Numba they become machine code that releases the interpreter lock; without it the same source runs
as Python, slowly but with the same result.

Compiling takes most of the first frame's time on a machine, so the functions are written to need little of it: the
caller allocates arrays, numbers that pass from function to function are of one type (``np.int64(0)``, where a literal 0
would be a type of its own, and a function that meets it compiled twice), and rows are sliced once instead of indexed
again and again.

Arrays that belong together can be handed over as a `typing.NamedTuple`. It is not for free: the references of every
array in it are counted in each call, so small functions that get one are compiled with ``inline="always"``.
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
    Numba can write: beside the source, else in the user's cache folder (``NUMBA_CACHE_DIR`` names another). Where no
    folder can be written, as in a read-only container, the function is compiled once a process.

    Args:
        function: A function of arrays and numbers in the part of Python that Numba understands.
        **options: Further options of `numba.njit`; ``cache`` and ``nogil`` are on unless given.

    Returns:
        The compiled function, or `function` itself where Numba is missing.
    """
    if function is None:
        return lambda decorated: _compile(decorated, options)
    return _compile(function, options)


def _compile(function: Function, options: dict[str, Any]) -> Function:
    if numba is None:
        return function
    # Nothing calls the functions from C, and an entry for it is compiled with each.
    kept, options = options.get("cache", True), {"nogil": True, "no_cfunc_wrapper": True, **options, "cache": False}
    dispatcher: Function = numba.njit(**options)(function)
    if kept and dispatcher is not function:  # it is with NUMBA_DISABLE_JIT, for a debugger
        from sgbd.machine.kept_code import keep_on_disk

        try:
            keep_on_disk(dispatcher)
        except RuntimeError as error:  # raised by Numba when it finds no folder to keep the code in
            if "cannot cache function" not in str(error):
                raise
            logger.info("no writable folder for compiled code: %s is compiled in every process", function.__qualname__)
    return dispatcher


def _announce_first_compilation() -> None:
    """Say once a process that loops are compiled, if they really are: those that are kept are read without a word."""

    class Announcement(event.Listener):
        told = False

        def on_start(self, compilation: Any) -> None:
            if not self.told and compilation.data["dispatcher"].__module__.startswith("sgbd."):
                self.told = True
                logger.info(
                    "compiling loops, once on this machine: it takes half a minute or less, longer on a busy processor"
                )

        def on_end(self, compilation: Any) -> None:
            """Nothing is said of it."""

    event.register("numba:compile", Announcement())


if HAS_NUMBA:
    _announce_first_compilation()
