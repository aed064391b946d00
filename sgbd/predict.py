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
from sgbd.prediction import find_frames, write_segmentation
from sgbd.segmenter import Segmenter
from sgbd.sources import FrameReadError
from sgbd.sources.camera import intrinsics_from

log = logging.getLogger(__name__)


@entry_point("predict")
def main(config: DictConfig) -> None:
    """Segment every frame; write label image, overlay and JSON while going on."""
    if config.on_error not in ("skip", "fail"):
        raise ConfigurationError(f"on_error must be skip or fail; got {config.on_error!r}")
    segmenter = Segmenter.load(
        find_checkpoint(config.checkpoint, config.output_dir),
        partition=instantiate(config.partition),
        rule=instantiate(config.objects),
        node_block=instantiate(config.node_block),
        device=config.device,
        trust=tuple(config.trust),
    )
    frames = find_frames(
        config.rgb, config.depth, intrinsics_from(config.intrinsics), config.depth_scale, config.time_tolerance
    )
    folder = output_folder() if config.output is None else Path(config.output).expanduser()
    failed = 0
    for index in ProgressBar(range(len(frames)), "segmenting", unit="frame"):
        try:
            frame = frames[index]
        except (FrameError, FrameReadError) as error:
            if config.on_error == "fail":
                raise
            failed += 1
            log.error("skipped %s: %s", frames.names[index], error)
            continue
        write_segmentation(frame, segmenter.segment_frame(frame), folder)
    if failed == len(frames):
        raise ConfigurationError(f"none of the {failed} frames could be read; the messages above say why")
    done = len(frames) - failed
    print(f"Objects of {done} frame{'s'[: done != 1]}: {folder}" + (f" ({failed} skipped)" if failed else ""))


if __name__ == "__main__":
    main()
