"""Early checks that configured classes fit their purpose, before hours are spent on frames and graphs."""

from __future__ import annotations

import inspect
from typing import Any

from sgbd.jobs.configuration import ConfigurationError


def require_kind(made: object, kind: type, group: str) -> None:
    """Check that an object is an instance, or a class is a subclass, of a class.

    Args:
        made: The object or the class.
        kind: The required class.
        group: The configuration group that chose it.

    Raises:
        ConfigurationError: If it is not.
    """
    cls = made if inspect.isclass(made) else type(made)
    if not issubclass(cls, kind):
        raise ConfigurationError(
            f"{group}: {_named(made)} is no {kind.__module__}.{kind.__qualname__}, of which it must be a subclass"
        )


def require_call(made: Any, protocol: Any, group: str) -> None:
    """Check that an object can be called with the arguments of a protocol.

    Args:
        made: The object.
        protocol: A class with the method `__call__`.
        group: The configuration group that chose it.

    Raises:
        ConfigurationError: If it cannot.
    """
    expected = list(inspect.signature(protocol.__call__).parameters)[1:]
    try:
        inspect.signature(made).bind(*expected)
    except TypeError as error:
        raise ConfigurationError(
            f"{group}: {_named(made)} cannot be called with ({', '.join(expected)}), as "
            f"{protocol.__module__}.{protocol.__qualname__} is: {error}"
        ) from error


def _named(made: object) -> str:
    cls = made if inspect.isclass(made) else type(made)
    return f"{cls.__module__}.{cls.__qualname__}"
