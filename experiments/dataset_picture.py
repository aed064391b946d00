"""Draw frames of a dataset side by side, colours above instances.

    python experiments/dataset_picture.py dataset=tabletop split=test count=4 output=experiments/pictures/dataset.png

`dataset` is an option of conf/dataset; synthetic datasets must be generated first (python -m sgbd.prepare).
"""

from __future__ import annotations

import sys
from pathlib import Path

import imageio.v3 as iio
import numpy as np
from hydra import compose, initialize_config_dir
from hydra.utils import instantiate
from omegaconf import OmegaConf

from sgbd.jobs.configuration import config_folder
from sgbd.reporting.overlay import overlay

ROOT = Path(__file__).resolve().parents[1]


def main() -> None:
    """Write the picture."""
    given = OmegaConf.to_container(OmegaConf.from_cli(sys.argv[1:]))
    assert isinstance(given, dict)
    with initialize_config_dir(str(config_folder()), version_base="1.3"):
        config = compose("prepare", [f"dataset={given.get('dataset', 'tabletop')}", f"data_dir={ROOT / 'data'}"])
    source = instantiate(config.dataset, split=given.get("split", "test"))
    chosen = np.linspace(0, len(source) - 1, int(given.get("count", 4))).round().astype(int)
    frames = [source[int(place)] for place in chosen]
    top = np.concatenate([frame.rgb for frame in frames], axis=1)
    bottom = np.concatenate(
        [overlay(frame.rgb, frame.instances, first=2) for frame in frames if frame.instances is not None], axis=1
    )
    # Halve the resolution for display on a page.
    picture = np.concatenate([top, bottom], axis=0)[::2, ::2]
    output = Path(given.get("output", "experiments/pictures/dataset.png"))
    output.parent.mkdir(parents=True, exist_ok=True)
    iio.imwrite(output, picture)
    print(output)


if __name__ == "__main__":
    main()
