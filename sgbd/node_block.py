"""Extra node features: a block of columns, each the mean of an image plane over a superpixel.

The columns of `sgbd.features` are cheap and part of every graph. A node block is expensive or needs weights of its own.
It is therefore computed only for models that use its group, stored beside the graphs (`sgbd.node_block_cache`), and
appended to their columns.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Sequence
from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt

from sgbd.adjacency import LabelMap
from sgbd.features import NODE_GROUPS
from sgbd.machine.availability import NotAvailableError

Planes = npt.NDArray[np.float32]


class NodeBlockError(ValueError):
    """Raised if feature groups and a node block do not fit each other; the message says what to choose."""


class MissingWeightsError(NotAvailableError):
    """Raised if the weights of a node block, or packages that it needs, are missing on this machine."""


class NodeBlock(ABC):
    """Node feature columns that are computed from the colours of a frame.

    Attributes:
        group: Name of the group of these columns, in addition to those of `sgbd.features.NODE_GROUPS`.
    """

    group: ClassVar[str]

    @property
    @abstractmethod
    def names(self) -> tuple[str, ...]:
        """Names of the M columns."""

    @abstractmethod
    def planes(self, images: Sequence[npt.NDArray[np.uint8]]) -> list[Planes]:
        """Compute the image planes that are pooled over superpixels.

        Args:
            images: uint8 [H, W, 3] each, RGB.

        Returns:
            float32 [M, H, W] for each image.
        """

    @abstractmethod
    def recipe(self) -> dict[str, Any]:
        """Return the configuration that recreates this block, with everything its values depend on, as JSON values."""

    def cache_key(self) -> dict[str, Any]:
        """Return everything that the columns depend on besides the frames, as JSON values."""
        # Imported here, so that a segmenter without a block does not import the modules that recipes need.
        from sgbd.recipe import code_digest

        return {**self.recipe(), "names": list(self.names), "code": code_digest([type(self).__module__])}

    def __call__(
        self, images: Sequence[npt.NDArray[np.uint8]], label_maps: Sequence[LabelMap]
    ) -> list[npt.NDArray[np.float32]]:
        """Compute the columns for several frames.

        Args:
            images: uint8 [H, W, 3] each, RGB.
            label_maps: int32 [H, W] each, ids 0..N-1.

        Returns:
            float32 [N, M] for each frame.
        """
        return [
            mean_over_superpixels(label_map, planes)
            for label_map, planes in zip(label_maps, self.planes(images), strict=True)
        ]


def mean_over_superpixels(label_map: LabelMap, planes: Planes) -> npt.NDArray[np.float32]:
    """Average image planes over each superpixel.

    Args:
        label_map: int32 [H, W], ids 0..N-1, each present.
        planes: float32 [M, H, W].

    Returns:
        float32 [N, M].
    """
    flat = label_map.ravel()
    sums = np.stack([np.bincount(flat, plane.ravel()) for plane in planes], axis=1)
    return (sums / np.bincount(flat)[:, None]).astype(np.float32)


def split_groups(groups: Iterable[str] | None) -> tuple[list[str] | None, list[str]]:
    """Split node feature groups into those of every graph and others, which only a node block can provide.

    Args:
        groups: Names of groups; None for all groups of every graph.

    Returns:
        The names that are in `sgbd.features.NODE_GROUPS` (None for all of them), and the other names.
    """
    if groups is None:
        return None, []
    names = list(groups)
    return [name for name in names if name in NODE_GROUPS], [name for name in names if name not in NODE_GROUPS]


def required_block(groups: Iterable[str] | None, block: NodeBlock | None) -> NodeBlock | None:
    """Return the block if a group needs it, else None.

    Args:
        groups: Node feature groups.
        block: The configured block.

    Raises:
        NodeBlockError: If a group is neither in `sgbd.features.NODE_GROUPS` nor that of the block.
    """
    _, others = split_groups(groups)
    unknown = [name for name in others if block is None or name != block.group]
    if unknown:
        choices = ", ".join([*NODE_GROUPS, *([block.group] if block is not None else [])])
        hint = "" if block is not None else ", or a node_block that has it (node_block=dino_vits16 has the group dino)"
        raise NodeBlockError(f"unknown node feature group {', '.join(unknown)}; choose from {choices}{hint}")
    return block if others else None
