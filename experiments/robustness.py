"""Score a model on changed frames: other lighting, sensors, sizes and distances.

    python experiments/robustness.py checkpoint=pretrained dataset=mosd dataset.root=FOLDER

Prints overlap F, F@.75 and boundary F (`unaided`, per cent) for each change of the frames, and their mean over all
changes; then for frames segmented at half their size (`reduce=2`). All arguments are overrides of conf/evaluate.yaml.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial

import numpy as np
import numpy.typing as npt
import pandas as pd
from hydra import compose, initialize_config_dir
from scipy.ndimage import gaussian_filter
from skimage.transform import resize

from sgbd.checkpoint import Checkpoint, find_checkpoint
from sgbd.evaluation import mean_scores
from sgbd.frame import Frame, Intrinsics
from sgbd.frame_augmentation import mirrored
from sgbd.jobs.configuration import config_folder, count_workers
from sgbd.jobs.pipeline import frame_source_of_split
from sgbd.label_map_evaluation import score_label_map
from sgbd.machine.progress_bar import ProgressBar
from sgbd.segmenter import Segmenter
from sgbd.sources import FrameSource

SCORES = {"F": "overlap_f", "F@.75": "f75", "boundary F": "boundary_f"}

Change = Callable[[Frame, np.random.Generator], Frame]
Floats = npt.NDArray[np.float64]


def resized(frame: Frame, rng: np.random.Generator, factor: float) -> Frame:
    """Change the number of pixels: colours are interpolated, depth and ground truth are those of the nearest pixel."""
    size = round(factor * frame.height), round(factor * frame.width)
    rows, columns = (((np.arange(count) + 0.5) / factor).astype(np.intp) for count in size)
    nearest = np.ix_(rows, columns)
    camera = frame.camera
    return replace(
        frame,
        rgb=np.round(resize(frame.rgb, size, order=1, preserve_range=True, anti_aliasing=factor < 1)).astype(np.uint8),
        depth=frame.depth[nearest],
        instances=None if frame.instances is None else frame.instances[nearest],
        intrinsics=Intrinsics(
            camera.fx * factor, camera.fy * factor, (camera.cx + 0.5) * factor - 0.5, (camera.cy + 0.5) * factor - 0.5
        ),
    )


def colored(change: Callable[[Floats, np.random.Generator], Floats]) -> Change:
    """Return a change of the colours, float64 [H, W, 3], 0 to 255; the result is clipped to this range."""

    def changed(frame: Frame, rng: np.random.Generator) -> Frame:
        colors = change(frame.rgb.astype(float), rng)
        return replace(frame, rgb=np.clip(np.round(colors), 0, 255).astype(np.uint8))

    return changed


def distant(frame: Frame, rng: np.random.Generator, factor: float) -> Frame:
    """Scale the scene, with everything in it, and its distance: the image stays the same."""
    return replace(frame, depth=frame.depth * np.float32(factor))


def noisy_depth(frame: Frame, rng: np.random.Generator, at_one_meter: float) -> Frame:
    """Add noise of this standard deviation at one metre, which grows with the square of the distance."""
    noise = at_one_meter * rng.standard_normal(frame.depth.shape)
    return replace(frame, depth=np.maximum(frame.depth + noise * frame.depth**2, 0).astype(np.float32))


def pierced(frame: Frame, rng: np.random.Generator, share: float) -> Frame:
    """Remove a share of the depth, in blobs."""
    blobs = gaussian_filter(rng.standard_normal(frame.depth.shape), 6)
    return replace(frame, depth=np.where(blobs < np.quantile(blobs, share), np.float32(0), frame.depth))


def displaced(frame: Frame, rng: np.random.Generator, pixels: int) -> Frame:
    """Shift colours against depth, as with a wrong registration."""
    return replace(frame, rgb=np.roll(frame.rgb, pixels, axis=1))


CHANGES: Mapping[str, Change] = {
    "none": lambda frame, rng: frame,
    "mirrored": lambda frame, rng: mirrored(frame),
    "half the width and height": partial(resized, factor=0.5),
    "twice the width and height": partial(resized, factor=2.0),
    "0.35 times as bright": colored(lambda rgb, rng: 0.35 * rgb),
    "1.7 times as bright, clipped": colored(lambda rgb, rng: 1.7 * rgb),
    "gray": colored(lambda rgb, rng: np.repeat(rgb.mean(2, keepdims=True), 3, axis=2)),
    "red and blue swapped": colored(lambda rgb, rng: rgb[..., ::-1]),
    "colours blurred by 2 pixels": colored(lambda rgb, rng: gaussian_filter(rgb, (2, 2, 0))),
    "noise on colours, 15 of 255": colored(lambda rgb, rng: rgb + rng.normal(0, 15, rgb.shape)),
    "noise on depth, 4 mm at 1 m": partial(noisy_depth, at_one_meter=0.004),
    "a fifth of the depth missing": partial(pierced, share=0.2),
    "colours shifted by 4 pixels": partial(displaced, pixels=4),
    "0.7 times as large and as far": partial(distant, factor=0.7),
    "1.5 times as large and as far": partial(distant, factor=1.5),
}

REDUCED = ("none", "twice the width and height")
"""Changes that are also scored with frames segmented at half their size."""


def scored(change: Change, name: str, segmenter: Segmenter, source: FrameSource) -> dict[str, float]:
    """Score a model on all frames after a change; return `SCORES` by title, per cent."""
    found = []
    for index in ProgressBar(range(len(source)), name, unit="frame", leave=False):
        frame = change(source[index], np.random.default_rng(index))
        judged = score_label_map(segmenter.segment_frame(frame).instances, frame, decides_objects=True)
        found.append(judged.scores)
    scores = mean_scores(found, source.seen).scores
    return {title: 100 * scores[f"unaided/{key}"] for title, key in SCORES.items()}


def main() -> None:
    """Print the table."""
    with initialize_config_dir(str(config_folder()), version_base="1.3"):
        config = compose("evaluate", sys.argv[1:])
    checkpoint = Checkpoint.load(find_checkpoint(config.checkpoint, config.output_dir), tuple(config.trust))
    segmenter, reducing = Segmenter(checkpoint), Segmenter(checkpoint, reduce=2)
    source = frame_source_of_split(config.dataset, count_workers(config.workers), config.split)
    table = pd.DataFrame({name: scored(change, name, segmenter, source) for name, change in CHANGES.items()}).T
    table.loc["**mean of all changes**"] = table.drop(index="none").mean()
    for name in REDUCED:
        table.loc[f"{name}, `reduce=2`"] = scored(CHANGES[name], name, reducing, source)
    table.index.name = "change"
    print(table.to_markdown(floatfmt=".1f"))


if __name__ == "__main__":
    main()
