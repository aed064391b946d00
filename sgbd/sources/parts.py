"""Assign parts of a dataset to train, val and test, for datasets without splits or with different ones."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping

SPLITS = ("train", "val", "test")


def checked_parts(parts: Mapping[str, Iterable[str]], split: str) -> dict[str, tuple[str, ...]]:
    """Validate the parts of each split and return them in the order train, val, test.

    Args:
        parts: Parts by split, such as {"train": ["ARID10"], "test": ["YCB10"]}; a part may be a nested folder.
        split: The requested split.

    Raises:
        ValueError: If a split is unknown or has no parts, or if two splits share a part.
    """
    if split not in SPLITS:
        raise ValueError(f"no split {split!r}; choose from {', '.join(SPLITS)}")
    unknown = sorted(set(parts) - set(SPLITS))
    if unknown or not parts or any(isinstance(names, str) or not list(names) for names in parts.values()):
        raise ValueError(
            f"parts must give a list of parts for some of {', '.join(SPLITS)}, such as {{test: [learn, test]}}; "
            f"got {dict(parts)}"
        )
    result = {key: tuple(name.strip("/") for name in parts[key]) for key in SPLITS if key in parts}
    owner: dict[str, str] = {}
    for key, names in result.items():
        for name in names:
            for other, its in owner.items():
                if its != key and (f"{name}/".startswith(f"{other}/") or f"{other}/".startswith(f"{name}/")):
                    raise ValueError(f"{name} would be in {its} and in {key}; a part can be in one split only")
            owner[name] = key
    return result


def natural_order(name: str) -> list[str | int]:
    """Return a sort key that puts learn2 before learn10."""
    return [int(piece) if piece.isdigit() else piece for piece in re.split(r"(\d+)", name)]
