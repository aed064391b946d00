"""Write the frames of a dataset as image files, for segmentation by other systems.

    python experiments/export_frames.py dataset=tabletop split=test output=frames_of_tabletop [data_dir=data]

It writes NAME_rgb.png and NAME_depth.png (uint16, millimetres, 0 = missing), replacing each `/` in a name by `_`, and
prints the camera. The other system must write one label image NAME.png per frame, with 0 for no object. Score its
results with python -m sgbd.evaluate predictions=<folder>, or next to other methods with python -m sgbd.compare
predictions='{its name: <folder>}'.
"""

from __future__ import annotations

import sys
from pathlib import Path

import imageio.v3 as iio
import numpy as np
from hydra import compose, initialize_config_dir
from hydra.utils import instantiate
from omegaconf import OmegaConf

from sgbd.frame import MILLIMETERS
from sgbd.jobs.configuration import config_folder
from sgbd.machine.progress_bar import ProgressBar

OWN = ("split", "output")


def main() -> None:
    """Write the frames."""
    given = OmegaConf.from_cli(sys.argv[1:])
    overrides = [argument for argument in sys.argv[1:] if argument.partition("=")[0] not in OWN]
    with initialize_config_dir(str(config_folder()), version_base="1.3"):
        config = compose("prepare", overrides)
    source = instantiate(config.dataset, split=given.get("split", "test"))
    if "output" not in given:
        raise SystemExit("say where to write the frames: output=<folder>")
    output = Path(str(given.output))
    output.mkdir(parents=True, exist_ok=True)
    cameras = set()
    for frame in ProgressBar(source, "writing", len(source), unit="frame"):
        stem = frame.name.replace("/", "_")
        depth = np.clip(frame.depth / MILLIMETERS, 0, 65535).round().astype(np.uint16)
        iio.imwrite(output / f"{stem}_rgb.png", frame.rgb)
        iio.imwrite(output / f"{stem}_depth.png", depth)
        camera = frame.camera
        cameras.add((camera.fx, camera.fy, camera.cx, camera.cy))
    print(f"{len(source)} frames in {output}; fx fy cx cy: {'; '.join(' '.join(map(str, one)) for one in cameras)}")


if __name__ == "__main__":
    main()
