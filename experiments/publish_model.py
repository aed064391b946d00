"""Add a trained checkpoint to the package, as the model that `Segmenter.pretrained()` loads.

    python experiments/publish_model.py outputs/second_stage/<time>/checkpoint.safetensors

Folder paths of the training machine and validation scores of the training are removed. Weights are rounded to float16.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

from without_folders import without_folders

from sgbd.agglomeration import AgglomeratedGraph
from sgbd.checkpoint import PRETRAINED_FILE, Checkpoint

LIMIT = 400_000
"""Maximum size of the packaged model, bytes."""


def published(checkpoint: Checkpoint) -> Checkpoint:
    """Return a checkpoint with rounded weights, without folder paths of the training machine and training scores.

    Args:
        checkpoint: The model, of one or two stages; its weights are rounded in place.
    """
    for network in (checkpoint.model, checkpoint.objectness):
        for weight in [] if network is None else network.parameters():
            weight.data = weight.data.half().float()
    recipe = {key: value for key, value in checkpoint.recipe.items() if key != "scores"}
    if isinstance(recipe.get("dataset"), dict):
        recipe["dataset"] = without_folders(recipe["dataset"])
    if checkpoint.first_stage is None:
        return replace(checkpoint, recipe=recipe)
    first_stage = published(checkpoint.first_stage)
    # The recipe identifies its first stage by a digest of its content, with the rounded weights as float32.
    recipe["graph"] = {**recipe["graph"], "first_stage": AgglomeratedGraph(first_stage).first_stage}
    return replace(checkpoint, recipe=recipe, first_stage=first_stage)


def main() -> None:
    """Write the packaged model."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("checkpoint", type=Path)
    parser.add_argument("--output", type=Path, default=PRETRAINED_FILE)
    arguments = parser.parse_args()
    model = published(Checkpoint.load(arguments.checkpoint))
    size = len(model.to_bytes(half_precision=True))
    if size > LIMIT:
        raise SystemExit(f"the model has {size} bytes; the limit of the packaged model is {LIMIT}")
    print(f"{model.save(arguments.output, half_precision=True)}: {size} bytes")


if __name__ == "__main__":
    main()
