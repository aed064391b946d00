"""python -m sgbd.predict: find the objects in a frame, a folder of frames, a recording or two videos."""

from __future__ import annotations

import logging
from pathlib import Path

from hydra.utils import instantiate
from omegaconf import DictConfig

from sgbd.checkpoint import find_checkpoint
from sgbd.frame import FrameError
from sgbd.jobs.configuration import ConfigurationError, entry_point, output_folder
from sgbd.machine.progress_bar import ProgressBar
from sgbd.prediction import label_images_in_the_way, segment_ahead, write_segmentation
from sgbd.segmenter import Segmenter
from sgbd.sources.camera import intrinsics_from
from sgbd.sources.find_frames import find_frames

log = logging.getLogger(__name__)


@entry_point("predict")
def main(config: DictConfig) -> None:
    """Segment every frame, and write its label image, overlay and JSON file as soon as it is done."""
    if config.on_error not in ("skip", "fail"):
        raise ConfigurationError(f"on_error must be skip or fail; got {config.on_error!r}")
    segmenter = Segmenter.load(
        find_checkpoint(config.checkpoint, config.output_dir),
        partition=instantiate(config.partition),
        rule=instantiate(config.objects),
        node_block=instantiate(config.node_block),
        device=config.device,
        trust=tuple(config.trust),
        reduce=config.reduce,
    )
    frames = find_frames(
        config.rgb, config.depth, intrinsics_from(config.intrinsics), config.depth_scale, config.time_tolerance
    )
    folder = output_folder() if config.output is None else Path(config.output).expanduser()
    in_the_way = label_images_in_the_way(frames, folder)
    if in_the_way:
        raise ConfigurationError(
            f"{len(in_the_way)} label images of the frames themselves would be replaced, such as {in_the_way[0]}. Give "
            "another folder for the results: output=<folder>"
        )
    failed = 0
    results = ProgressBar(segment_ahead(frames, segmenter), "segmenting", len(frames), unit="frame")
    for name, result in zip(frames.names, results, strict=True):
        if isinstance(result, FrameError):
            if config.on_error == "fail":
                raise result
            failed += 1
            log.error("skipped %s: %s", name, result)
        else:
            frame, segmentation = result
            write_segmentation(frame, segmentation, folder, draw=config.overlays)
    if failed == len(frames):
        raise ConfigurationError(f"none of the {failed} frames could be read; the messages above say why")
    done = len(frames) - failed
    print(f"Objects of {done} frame{'s'[: done != 1]}: {folder}" + (f" ({failed} skipped)" if failed else ""))


if __name__ == "__main__":
    main()
