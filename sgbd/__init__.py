"""Zero-shot instance segmentation of cluttered RGB-D scenes on superpixel graphs.

Where to find what:

- Frames: `frame`, the readers and the synthetic dataset in `sources`, `frame_augmentation`, and `reduction` to a
  fraction of their size.
- The graph of a frame: `superpixels`, `adjacency`, `regions` (one pass over the pixels), `features`, `graph_arrays`
  (NumPy), `graph` (PyG). The graph of a second stage: `agglomeration`, `own_columns`. Extra node features:
  `node_block`, `dino`.
- Graphs on disk: `preparation` writes each graph to a `graph_file`, with its `label_map` packed, in a folder named
  after their `recipe`. `node_block_cache` stores extra columns beside them. `data` is the PyG dataset that reads them.
- Networks: `models` (`models.averaging` makes one of several trainings), the tensors that they read without PyG
  (`graph_tensors`), and the `checkpoint` of both stages.
- Training: `batches`, `augmentation`, `sampling`, `losses`. `training` has the loop, the checks before the first epoch,
  and the state from which an interrupted training resumes.
- From classified edges to objects: `partition`, `segmentation`, `repaint`, `calibration` of the scores. `segmenter`
  runs all steps on a frame, `prediction` on files.
- Scores: `majority`, `metrics`, `evaluation` of graphs, `label_map_evaluation` of other methods and of `label_images`,
  `failures` by kind. `scored_partition` and `tuning` choose thresholds.
- Reports: `reporting` (names of scores, pictures, the files of an evaluation, the page of a run or sweep).
- Configured runs: `jobs` (configuration and hints on mistyped arguments, frames and graphs, the untrained model, from
  frames to scores, single jobs in their folders, sweeps and their tables).
- Comparisons: `baselines`, `comparison`, `comparison_results`; `benchmarking` of speed and memory; `onnx_export`.
- The machine: `machine` (compiled loops, threads, processes, memory, files, progress bars).
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
