"""A tiny vision transformer, saved to a folder in the format of published ones."""

from __future__ import annotations

from pathlib import Path

import torch

HEADS, PATCH = 3, 8


def save_small_vit(folder: Path, seed: int = 0, heads: int = HEADS) -> Path:
    """Write `config.json` and `model.safetensors` of a randomly initialised `ViTModel` with large weights."""
    from transformers import ViTConfig, ViTModel

    config = ViTConfig(
        hidden_size=4 * heads,
        num_hidden_layers=2,
        num_attention_heads=heads,
        intermediate_size=16,
        image_size=4 * PATCH,
        patch_size=PATCH,
    )
    model = ViTModel(config, add_pooling_layer=False)
    generator = torch.Generator().manual_seed(seed)
    with torch.no_grad():
        for weight in model.parameters():
            weight.normal_(0, 0.3, generator=generator)
    model.save_pretrained(folder)
    return folder
