"""Convert the label values of a dataset to instance ids."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np
import numpy.typing as npt

from sgbd.frame import BACKGROUND, IGNORE, SUPPORT, FrameError
from sgbd.sources.errors import FrameReadError
from sgbd.sources.image import read_labels

FIRST_OBJECT = SUPPORT + 1
_UNKNOWN = np.iinfo(np.int32).min
_RANGE = re.compile(r"(\d+)(-(\d*))?")

Ids = Sequence[int | str]


class LabelRule:
    """Converts the labels of an image file to instance ids: -1 ignore, 0 background, 1 support, 2 and above objects.

    Each kind of pixel is given as a list of labels and ranges: `3`, `"1-9"`, or `"20-"` for 20 and above. The instance
    id of an object is `label // divisor + offset`; a divisor above 1 merges separately labelled parts of an object. A
    label that is in none of the lists is an error.

    Args:
        background: Labels of the background.
        support: Labels of the supporting surface (table, floor).
        ignore: Labels of pixels that are excluded from training and evaluation.
        objects: Labels of objects and their parts.
        divisor: Number of consecutive labels reserved for the parts of one object.
        offset: Added to object ids; 1 if the file has no support label and numbers its objects from 1.

    Raises:
        ValueError: If a list is malformed, a label is in two lists, or an object id would be below 2.

    Example:
        >>> mosd = LabelRule(background=[], ignore=[0], support=["1-9"], objects=["20-"], divisor=10)
        >>> mosd(np.array([[0, 3, 20, 29, 30]])).tolist()
        [[-1, 1, 2, 2, 3]]
    """

    def __init__(
        self,
        background: Ids = (BACKGROUND,),
        support: Ids = (SUPPORT,),
        ignore: Ids = (),
        objects: Ids = (f"{FIRST_OBJECT}-",),
        divisor: int = 1,
        offset: int = 0,
    ) -> None:
        if divisor < 1:
            raise ValueError(f"divisor must be at least 1; got {divisor}")
        self.background = _ranges(background, "background")
        self.support = _ranges(support, "support")
        self.ignore = _ranges(ignore, "ignore")
        self.objects = _ranges(objects, "objects")
        self.divisor = divisor
        self.offset = offset
        everything = _in_order(self.background + self.support + self.ignore + self.objects)
        for (first, last), (following, _) in pairwise(everything):
            if last is None or following <= last:
                raise ValueError(f"label {following} has two meanings in {self}; the range from {first} holds it too")
        lowest = min((first for first, _ in self.objects), default=None)
        if lowest is not None and lowest // divisor + offset < FIRST_OBJECT:
            raise ValueError(
                f"object label {lowest} would get the id {lowest // divisor + offset}, but ids of objects start at "
                f"{FIRST_OBJECT} ({BACKGROUND} is background, {SUPPORT} the support); raise `offset`"
            )

    def __call__(self, labels: npt.NDArray[np.integer]) -> npt.NDArray[np.int32]:
        """Apply the rule.

        Args:
            labels: Non-negative integers [H, W].

        Returns:
            int32 [H, W] as in `sgbd.Frame.instances`.

        Raises:
            FrameError: If a label is negative or in none of the lists.
        """
        if labels.size and int(labels.min()) < 0:
            raise FrameError(f"labels must not be negative; got {int(labels.min())}")
        size = int(labels.max()) + 1 if labels.size else 1
        meaning = np.full(size, _UNKNOWN, dtype=np.int32)
        for ranges, value in ((self.background, BACKGROUND), (self.support, SUPPORT), (self.ignore, IGNORE)):
            for first, last in ranges:
                meaning[first : None if last is None else last + 1] = value
        for first, last in self.objects:
            span = np.arange(first, size if last is None else min(last + 1, size), dtype=np.int32)
            meaning[span] = span // self.divisor + self.offset
        instances = meaning[labels]
        if instances.size and int(instances.min()) == _UNKNOWN:
            unknown = np.unique(labels[instances == _UNKNOWN]).tolist()
            shown = ", ".join(map(str, unknown[:8])) + (", ..." if len(unknown) > 8 else "")
            raise FrameError(
                f"labels without a meaning: {shown}. The rule in use is {self}; state what they are in the dataset's "
                "`labels` option"
            )
        return instances

    def __repr__(self) -> str:
        kinds = ", ".join(
            f"{kind}={[_text(span) for span in getattr(self, kind)]}"
            for kind in ("background", "support", "ignore", "objects")
        )
        return f"LabelRule({kinds}, divisor={self.divisor}, offset={self.offset})"

    def __eq__(self, other: object) -> bool:
        return repr(self) == repr(other) if isinstance(other, LabelRule) else NotImplemented

    def __hash__(self) -> int:
        return hash(repr(self))


def read_instances(path: str | Path, rule: LabelRule) -> npt.NDArray[np.int32]:
    """Read a label image and convert it to instance ids.

    Args:
        path: Label image, see `sgbd.sources.image.read_labels`.
        rule: The meaning of its labels.

    Returns:
        int32 [H, W] as in `sgbd.Frame.instances`.

    Raises:
        FrameReadError: If the file is missing, damaged, not a label image, or has a label the rule does not define.
    """
    labels = read_labels(path)
    try:
        return rule(labels)
    except FrameError as error:
        raise FrameReadError(path, str(error)) from error


def detect_label_rule(frames: Iterable[tuple[npt.NDArray[np.int32], npt.NDArray[np.float32]]]) -> LabelRule:
    """Decide whether label images follow the rule `MOSD` or `PLAIN`.

    They follow `MOSD` if no label is between 10 and 19, some labels are 20 or above, and at least 95 % of the pixels
    with label 0 have no depth (in plain labels, 0 is the background, which has depth).

    Args:
        frames: Label image and depth image of some frames; depth in any unit, 0 = missing.
    """
    parts = zeros = zeros_with_depth = 0
    for labels, depth in frames:
        if labels.shape != depth.shape or ((labels >= 10) & (labels < 20)).any():
            return PLAIN
        parts += int(np.count_nonzero(labels >= 20))
        zero = labels == 0
        zeros += int(np.count_nonzero(zero))
        zeros_with_depth += int(np.count_nonzero(depth[zero]))
    return MOSD if parts and zeros_with_depth <= 0.05 * zeros else PLAIN


def _ranges(ids: Ids, kind: str) -> list[tuple[int, int | None]]:
    """Parse a list of labels and ranges to sorted (first, last) pairs; last is None for an open range."""
    if isinstance(ids, (str, int)):
        raise ValueError(f"{kind} must be a list of labels and ranges such as [0, '1-9', '20-']; got {ids!r}")
    spans: list[tuple[int, int | None]] = []
    for item in ids:
        match = _RANGE.fullmatch(str(item).strip())
        first = int(match[1]) if match else 0
        last = first if match and match[2] is None else int(match[3]) if match and match[3] else None
        if match is None or (last is not None and last < first):
            raise ValueError(f"{kind}: expected a label such as 3 or a range such as '1-9' or '20-'; got {item!r}")
        spans.append((first, last))
    return _in_order(spans)


def _in_order(spans: list[tuple[int, int | None]]) -> list[tuple[int, int | None]]:
    return sorted(spans, key=lambda span: span[0])


def _text(span: tuple[int, int | None]) -> int | str:
    first, last = span
    return first if last == first else f"{first}-" if last is None else f"{first}-{last}"


PLAIN = LabelRule()
"""0 is background, 1 is the supporting surface, every other label is an object."""

MOSD = LabelRule(background=(), support=("1-9",), ignore=(0,), objects=("20-",), divisor=10)
"""Labels of mOSD, the re-annotated Object Segmentation Database: 0 no depth, 1-9 table, 20-29 one object, ..."""
