"""Combine trainings that differ only in their seed into one checkpoint, which gives the mean of their logits.

    python experiments/average_networks.py FIRST SECOND THIRD --output averaged.safetensors

Each is a checkpoint of a gated graph convolution with an objectness head, or the folder of its training.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from sgbd.checkpoint import Checkpoint, find_checkpoint
from sgbd.models.averaging import average_heads, average_models

OF_ONE_TRAINING = ("seed", "scores", "tuning", "calibration")
"""Sections of the recipe in which the trainings may differ."""


def averaged(checkpoints: Sequence[Checkpoint]) -> Checkpoint:
    """Return a checkpoint whose logits are the mean of those of several checkpoints.

    Args:
        checkpoints: Trainings of one recipe with different seeds.

    Raises:
        ValueError: If their recipes differ in something else, or their networks cannot be averaged.
    """
    shared = [_without(checkpoint.recipe) for checkpoint in checkpoints]
    differing = sorted(key for recipe in shared for key in recipe if recipe[key] != shared[0].get(key))
    if differing:
        raise ValueError(
            f"the trainings differ not only in their seed: {', '.join(differing)}. "
            "Train them with tuning=none, and tune the averaged checkpoint"
        )
    heads = [checkpoint.objectness for checkpoint in checkpoints if checkpoint.objectness is not None]
    model, head = average_models([checkpoint.model for checkpoint in checkpoints]), average_heads(heads)
    widths = [len(heads) * width for width in shared[0]["objectness"]["hidden_channels"]]
    recipe = {
        **shared[0],
        "model": {**shared[0]["model"], "hidden_channels": model.hidden_channels},
        "objectness": {**shared[0]["objectness"], "hidden_channels": widths},
        "seed": [checkpoint.recipe["seed"] for checkpoint in checkpoints],
    }
    return Checkpoint(model, head, recipe, checkpoints[0].first_stage)


def _without(recipe: dict[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in recipe.items() if key not in OF_ONE_TRAINING}


def main() -> None:
    """Write the averaged checkpoint."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("checkpoints", nargs="+")
    parser.add_argument("--output", type=Path, required=True)
    arguments = parser.parse_args()
    try:
        members = [Checkpoint.load(find_checkpoint(path, ".")) for path in arguments.checkpoints]
        print(averaged(members).save(arguments.output))
    except ValueError as error:
        raise SystemExit(str(error)) from error


if __name__ == "__main__":
    main()
