"""Machine code that is kept on disk, read without what only compiling needs.

Before Numba reads the first function from disk it makes itself ready to compile: it imports all that it knows to
translate, `scipy.linalg` among it, and compiles its own functions for counting references, for which LLVM's optimiser
and code generator are read into memory. That takes some 50 MiB and a third of a second in every process, for nothing
where no function is compiled after that, as on a robot. What is read from disk needs the addresses of a few functions
of Numba's, no more; and whatever does compile makes itself ready in any case.
"""

from __future__ import annotations

import contextlib
import logging
from functools import cache
from pathlib import Path
from types import FunctionType
from typing import Any

import numba
from llvmlite import binding
from numba.core.caching import FunctionCache
from numba.core.dispatcher import Dispatcher

logger = logging.getLogger(__name__)

TRIED_VERSIONS = ("0.68",)
"""Versions of Numba that `KeptCode` was tried with: it uses what Numba does not promise to keep as it is."""
CAN_SKIP = ".".join(numba.__version__.split(".")[:2]) in TRIED_VERSIONS
"""If not, functions are read as Numba itself reads them."""


class KeptCode(FunctionCache):
    """The machine code of one function on disk.

    For functions of arrays and numbers. What else Numba's own preparation tells the linker, the secret of hashes of
    strings, it does not.
    """

    def _index_key(self, sig: Any, codegen: Any) -> Any:
        """Extend Numba's key, which knows the function's own file only, by everything compiled into the function."""
        return *super()._index_key(sig, codegen), dependencies(self._py_func)

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Read what is kept for a signature; None if nothing is, or it is damaged, as a power cut may leave it."""
        name_runtime_functions()
        try:
            with self._guard_against_spurious_io_errors():
                return self._load_overload(sig, target_context)
        except MemoryError:
            raise
        except Exception as error:  # whatever bytes that are no pickle, or no machine code, may lead to
            logger.warning("the kept code of %s cannot be read and is made again: %r", self._name, error)
            self._forget()
        return None

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keep the code of a signature, if there is room for it."""
        try:
            with self._guard_against_spurious_io_errors():
                self._save_overload(sig, data)
        except OSError as error:
            logger.warning("the compiled code of %s cannot be kept: %s", self._name, error)
            # It may name a file that was not written, in the place of which one of an earlier version lies.
            self._forget()

    def _forget(self) -> None:
        """Take away the list of what is kept."""
        with contextlib.suppress(OSError):
            Path(self._cache_file._index_path).unlink(missing_ok=True)


def dependencies(function: FunctionType) -> tuple[tuple[Any, ...], ...]:
    """Return what the machine code of a function takes from elsewhere.

    Args:
        function: The Python function. Compiled functions that it calls are followed, in other modules too.

    Returns:
        Name, time of change and size of the files of all these functions, then names and values of the module constants
        that they use; each part sorted.
    """
    stamps, constants = set(), set()
    seen, waiting = {function}, [function]
    while waiting:
        current = waiting.pop()
        stamps.add(_stamp(current.__code__.co_filename))
        for name in current.__code__.co_names:
            value = current.__globals__.get(name)
            if isinstance(value, bool | int | float | str | tuple):
                constants.add((f"{current.__module__}.{name}", repr(value)))
            elif isinstance(value, Dispatcher) and value.py_func not in seen:
                seen.add(value.py_func)
                waiting.append(value.py_func)
    return tuple(sorted(stamps)), tuple(sorted(constants))


@cache
def _stamp(file: str) -> tuple[str, int, int]:
    status = Path(file).stat()
    return Path(file).name, status.st_mtime_ns, status.st_size


@cache
def name_runtime_functions() -> None:
    """Tell the linker where Numba's functions for memory are, by the names that compiled code has for them."""
    from numba.core.runtime._nrt_python import c_helpers  # here: other versions may not have it

    for name, address in c_helpers.items():
        binding.add_symbol(name if name.startswith("_") else f"NRT_{name}", address)


def keep_on_disk(dispatcher: Any) -> None:
    """Have the machine code of a function kept on disk, and read from there.

    Args:
        dispatcher: What `numba.njit` gives.

    Raises:
        RuntimeError: If there is no folder to keep it in.
    """
    dispatcher.enable_caching()
    # Numba lets nobody choose the class. Its own is an ordinary object, which can take on another one.
    if CAN_SKIP:
        dispatcher._cache.__class__ = KeptCode
