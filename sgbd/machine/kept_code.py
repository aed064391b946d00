"""Machine code kept on disk, read without loading what is needed only to compile.

Before Numba reads the first function from disk, it prepares to compile: it imports everything it can translate,
including `scipy.linalg`, and compiles its own reference-counting functions, which loads LLVM's optimiser and code
generator. This takes about 50 MiB and a third of a second in every process, and is wasted if no function is compiled
afterwards, as on a robot. Code read from disk needs only the addresses of a few of Numba's functions, and compiling
makes these preparations itself.
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
"""Versions of Numba that `KeptCode` was tested with: it uses internals that may change between versions."""
CAN_SKIP = ".".join(numba.__version__.split(".")[:2]) in TRIED_VERSIONS
"""Whether this version of Numba was tested. If not, functions are read as Numba itself reads them."""


class KeptCode(FunctionCache):
    """The machine code of one function on disk.

    For functions of arrays and numbers only: unlike Numba's own preparation, it does not give the linker the secret of
    string hashes.
    """

    def _index_key(self, sig: Any, codegen: Any) -> Any:
        """Extend Numba's key, which covers only the function's own file, with all that is compiled into it."""
        return *super()._index_key(sig, codegen), dependencies(self._py_func)

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Read the code kept for a signature; None if there is none or it is damaged, for example by a power cut."""
        name_runtime_functions()
        try:
            with self._guard_against_spurious_io_errors():
                return self._load_overload(sig, target_context)
        except MemoryError:
            raise
        except Exception as error:  # damaged pickles and machine code may raise anything
            logger.warning("the kept code of %s cannot be read and is made again: %r", self._name, error)
            self._forget()
        return None

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keep the code of a signature, if there is room on the disk."""
        try:
            with self._guard_against_spurious_io_errors():
                self._save_overload(sig, data)
        except OSError as error:
            logger.warning("the compiled code of %s cannot be kept: %s", self._name, error)
            # The index may name a file that was not written, while an older version of that file is still there.
            self._forget()

    def _forget(self) -> None:
        """Delete the index of the kept code."""
        with contextlib.suppress(OSError):
            Path(self._cache_file._index_path).unlink(missing_ok=True)


def dependencies(function: FunctionType) -> tuple[tuple[Any, ...], ...]:
    """Return what the machine code of a function depends on.

    Args:
        function: The Python function. Compiled functions that it calls are followed, in other modules too.

    Returns:
        Name, modification time and size of the files of all these functions, then names and values of the module
        constants that they use; each part sorted.
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
    """Return name, modification time (ns) and size (bytes) of a file."""
    status = Path(file).stat()
    return Path(file).name, status.st_mtime_ns, status.st_size


@cache
def name_runtime_functions() -> None:
    """Give the linker the addresses of Numba's memory functions, under the names that compiled code uses."""
    from numba.core.runtime._nrt_python import c_helpers  # imported on use: other versions may lack it

    for name, address in c_helpers.items():
        binding.add_symbol(name if name.startswith("_") else f"NRT_{name}", address)


def keep_on_disk(dispatcher: Any) -> None:
    """Keep the machine code of a function on disk, and read it from there.

    Args:
        dispatcher: The result of `numba.njit`.

    Raises:
        RuntimeError: If there is no folder to keep it in.
    """
    dispatcher.enable_caching()
    # Numba has no option for the cache class, so change the class of the object that it created.
    if CAN_SKIP:
        dispatcher._cache.__class__ = KeptCode
