"""Zero-shot instance segmentation of cluttered RGB-D scenes on superpixel graphs."""

from importlib import import_module
from importlib.metadata import PackageNotFoundError, version
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from sgbd.data import SuperpixelGraphDataset
    from sgbd.frame import Frame, FrameError, Intrinsics
    from sgbd.segmentation import Segmentation
    from sgbd.segmenter import Segmenter

try:
    __version__ = version("sgbd")
except PackageNotFoundError:  # run from a folder that was not installed
    __version__ = "unknown"

# Imported on first use, so that `import sgbd` and the readers don't wait for PyTorch.
_HOMES = {
    "Frame": "sgbd.frame",
    "FrameError": "sgbd.frame",
    "Intrinsics": "sgbd.frame",
    "Segmentation": "sgbd.segmentation",
    "Segmenter": "sgbd.segmenter",
    "SuperpixelGraphDataset": "sgbd.data",
}

__all__ = ["Frame", "FrameError", "Intrinsics", "Segmentation", "Segmenter", "SuperpixelGraphDataset", "__version__"]


def __getattr__(name: str) -> Any:
    if name in _HOMES:
        return getattr(import_module(_HOMES[name]), name)
    raise AttributeError(f"module 'sgbd' has no attribute {name!r}")
