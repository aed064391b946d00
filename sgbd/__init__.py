"""Zero-shot instance segmentation of cluttered RGB-D scenes on superpixel graphs.

What is where:

- Frames: `frame`, their readers and the synthetic dataset in `sources`, `frame_augmentation`.
- A frame's graph: `superpixels`, `adjacency`, `regions` (one pass over the pixels), `features`, `graph_arrays` (NumPy),
  `graph` (PyG). A second stage's graph: `agglomeration`, `own_columns`. Further node features: `node_block`, `dino`.
- Graphs on disk: `preparation` makes them, each in a `graph_file` with its `label_map` packed, in a folder called by
  their `recipe`; `node_block_cache` keeps further columns beside them; `data` is the PyG dataset that reads them.
- Networks: `models`, the tensors that they read without PyG (`graph_tensors`), and a `checkpoint` of both stages.
- Training: `batches`, `augmentation`, `sampling`, `losses`, and in `training` the loop, what it looks at before the
  first epoch, and the state that an interrupted one goes on from.
- From classified edges to objects: `partition`, `segmentation`, `repaint`, `calibration` of the scores; all steps from
  a frame on in `segmenter`, from files to files in `prediction`.
- Scores: `majority`, `metrics`, `evaluation` of graphs, `label_map_evaluation` of other methods and of `label_images`,
  `failures` by kind; `scored_partition` and `tuning` choose thresholds.
- For people: `reporting` (names of scores, pictures, an evaluation's files, the page of a run or sweep).
- Runs as configured: `jobs` (configuration and hints at mistyped arguments, frames and graphs, the untrained model,
  from frames to scores, once in its folder, many and their table).
- Comparisons: `baselines`, `comparison`, `comparison_results`; `benchmarking` of speed and memory; `onnx_export`.
- What the machine has to give: `machine` (compiled loops, threads, processes, memory, files, progress bars).
- Commands, each run with ``python -m``: `prepare`, `train`, `tune`, `evaluate`, `predict`, `compare`, `report`,
  `export`, `feature_importance`, `benchmark`, `split`, `semantic_masks`.
"""

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
