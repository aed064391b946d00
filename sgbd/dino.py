"""Attention of a self-supervised vision transformer as node features (the implicit features of the paper)."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Sequence
from functools import cached_property
from itertools import groupby
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
import numpy.typing as npt
import torch
from torch import Tensor
from torch.nn.functional import interpolate, scaled_dot_product_attention

from sgbd.node_block import MissingWeightsError, NodeBlock, NodeBlockError, Planes

if TYPE_CHECKING:
    from transformers import ViTModel

IMAGE_MEAN, IMAGE_STD = (0.485, 0.456, 0.406), (0.229, 0.224, 0.225)
"""Mean and standard deviation of ImageNet's colours, by which the network's input must be standardised."""

INTERPOLATIONS = ("bilinear", "nearest")
_ATTENTION = "sgbd_class_token"
_unreachable: dict[str, str] = {}
"""Names whose weights this process could not load, with the reason: a process waits only once for a hub that does not
answer, not in every job of a sweep."""


class DinoAttention(NodeBlock):
    """Attention of the [CLS] token in the last block of a vision transformer, one column per head.

    The heads of DINO (M. Caron et al., "Emerging properties in self-supervised vision transformers", ICCV 2021,
    doi:10.1109/ICCV48922.2021.00951), trained without labels, attend to salient objects. The paper pools the six heads
    of ViT-S over each superpixel.

    The network sees the whole frame at its original size (stretched to whole patches). Its position encoding is
    interpolated as its authors do.

    Args:
        weights: Name on the Hugging Face hub, such as `facebook/dino-vits16`, or a local folder with `config.json` and
            `model.safetensors` of a `ViTModel`.
        normalize: Scale the attention of each head to 0..1 within the image, as the paper does. Otherwise it is the
            softmax weight of the patch times the number of patches, so that uniform attention is 1 at any image size.
        interpolation: Interpolation from patches to pixels: `bilinear` or `nearest`.
        batch_size: Images per forward pass.
        device: `auto` (a GPU if there is one), `cpu`, `cuda`, ...
        weights_digest: Required SHA-256 of the weights; None accepts any. Checkpoints store the digest of the weights
            they were trained with.

    Raises:
        ValueError: If an argument is out of range.
    """

    group: ClassVar[str] = "dino"

    def __init__(
        self,
        weights: str | Path = "facebook/dino-vits16",
        normalize: bool = True,
        interpolation: str = "bilinear",
        batch_size: int = 8,
        device: str = "auto",
        weights_digest: str | None = None,
    ) -> None:
        if interpolation not in INTERPOLATIONS:
            raise ValueError(
                f"node_block.interpolation must be one of {', '.join(INTERPOLATIONS)}; got {interpolation!r}"
            )
        if batch_size < 1:
            raise ValueError(f"node_block.batch_size must be at least 1; got {batch_size}")
        self.weights = str(weights)
        self.normalize = normalize
        self.interpolation = interpolation
        self.batch_size = batch_size
        self.device = device
        self.weights_digest = weights_digest

    @cached_property
    def model(self) -> ViTModel:
        """The network in evaluation mode on its device, loaded on first use.

        Raises:
            MissingWeightsError: If `transformers` or the weights are missing.
            NodeBlockError: If the weights are not a complete `ViTModel`, or do not match `weights_digest`.
        """
        try:
            from transformers import AttentionInterface, ViTModel
            from transformers.utils import logging as transformers_logging
        except ImportError as error:
            raise MissingWeightsError(
                f"DINO features need the package transformers, which cannot be imported ({error}). Install the extra: "
                "pip install 'sgbd[dino]'"
            ) from error
        AttentionInterface.register(_ATTENTION, _attend_and_tell_class_token)
        transformers_logging.disable_progress_bar()
        folder = Path(self.weights).expanduser()
        try:
            if self.weights in _unreachable and not folder.is_dir():
                raise OSError(_unreachable[self.weights])
            model, found = ViTModel.from_pretrained(
                str(folder) if folder.is_dir() else self.weights,
                add_pooling_layer=False,
                attn_implementation=_ATTENTION,
                dtype=torch.float32,
                output_loading_info=True,
            )
        except (OSError, ValueError) as error:
            if not folder.is_dir():
                _unreachable[self.weights] = str(error)
            raise MissingWeightsError(
                f"the weights {self.weights!r} cannot be read: {str(error).splitlines()[0]} Give node_block.weights a "
                "name on the Hugging Face hub (which needs the network once), or a folder with config.json and "
                "model.safetensors of a ViTModel."
            ) from error
        if found["missing_keys"] or found["mismatched_keys"]:
            lacking = sorted(map(str, [*found["missing_keys"], *found["mismatched_keys"]]))
            raise NodeBlockError(
                f"the weights {self.weights!r} are no complete ViTModel: {len(lacking)} tensors are missing or of "
                f"another shape, such as {lacking[0]}. Give node_block.weights the folder of a whole model."
            )
        digest = _digest(model)
        if self.weights_digest not in (None, digest):
            raise NodeBlockError(
                f"the weights {self.weights!r} are not those that are asked for: SHA-256 {digest[:12]}... instead of "
                f"{str(self.weights_digest)[:12]}.... Give node_block.weights the folder of the weights that the model "
                "was trained with."
            )
        return model.eval().to(self._device())

    def _device(self) -> torch.device:
        if self.device == "auto":
            return torch.device("cuda" if torch.cuda.is_available() else "cpu")
        return torch.device(self.device)

    @property
    def names(self) -> tuple[str, ...]:
        """Column names `dino_0`, `dino_1`, ..., one per head."""
        return tuple(f"{self.group}_{head}" for head in range(self.model.config.num_attention_heads))

    def recipe(self) -> dict[str, Any]:
        """Return the configuration that recreates this block, with the digest of its weights."""
        return {
            "_target_": f"{type(self).__module__}.{type(self).__qualname__}",
            "weights": self.weights,
            "normalize": self.normalize,
            "interpolation": self.interpolation,
            "weights_digest": _digest(self.model),
        }

    def cache_key(self) -> dict[str, Any]:
        """Return the cache key of `NodeBlock`, without the location of the weights: their digest identifies them."""
        return {key: value for key, value in super().cache_key().items() if key != "weights"}

    def planes(self, images: Sequence[npt.NDArray[np.uint8]]) -> list[Planes]:
        """Compute the attention to every pixel (`NodeBlock.planes`). Consecutive images of one size share batches."""
        return [plane for batch in self._batches(images) for plane in self._attention(batch)]

    def _batches(self, images: Sequence[npt.NDArray[np.uint8]]) -> Iterator[npt.NDArray[np.uint8]]:
        for _, same in groupby(images, key=lambda image: image.shape):
            alike = list(same)
            for start in range(0, len(alike), self.batch_size):
                yield np.stack(alike[start : start + self.batch_size])

    @torch.inference_mode()
    def _attention(self, images: npt.NDArray[np.uint8]) -> Planes:
        model, patch = self.model, int(self.model.config.patch_size)
        height, width = images.shape[1:3]
        rows, columns = (max(1, round(side / patch)) for side in (height, width))
        mean, std = (torch.tensor(values, device=model.device).view(3, 1, 1) for values in (IMAGE_MEAN, IMAGE_STD))
        pixels = torch.from_numpy(images).to(model.device).permute(0, 3, 1, 2).float() / 255
        if (rows * patch, columns * patch) != (height, width):
            pixels = interpolate(pixels, (rows * patch, columns * patch), mode="bilinear", antialias=True)
        output = model((pixels - mean) / std, interpolate_pos_encoding=True, output_attentions=True)
        # [B, M, 1, 1 + patches]: the attention of the [CLS] token to all tokens, of which it is the first.
        attention = output.attentions[-1][:, :, 0, 1:].unflatten(2, (rows, columns))
        if self.normalize:
            low, high = attention.amin((2, 3), keepdim=True), attention.amax((2, 3), keepdim=True)
            attention = (attention - low) / (high - low).clamp(min=1e-12)
        else:
            attention = attention * (rows * columns)
        options = {"align_corners": False} if self.interpolation == "bilinear" else {}
        upsampled: Planes = interpolate(attention, (height, width), mode=self.interpolation, **options).cpu().numpy()
        return upsampled

    def __getstate__(self) -> dict[str, Any]:
        # A process that receives this block loads the weights again, which is cheaper than pickling them.
        return {key: value for key, value in self.__dict__.items() if key != "model"}


def _attend_and_tell_class_token(
    module: torch.nn.Module,
    query: Tensor,
    key: Tensor,
    value: Tensor,
    attention_mask: Tensor | None,
    scaling: float | None = None,
    dropout: float = 0.0,
    **_: Any,
) -> tuple[Tensor, Tensor]:
    """Compute scaled dot-product attention, and return it with only the attention weights of the first token.

    All weights of 4800 patches (ViT-S/8 on 640 x 480) would take half a gigabyte per block; one row takes 100 KiB.
    """
    scale = query.shape[-1] ** -0.5 if scaling is None else scaling
    attended = scaled_dot_product_attention(query, key, value, attn_mask=attention_mask, scale=scale)
    weights = (scale * query[:, :, :1] @ key.transpose(2, 3)).softmax(-1)
    return attended.transpose(1, 2).contiguous(), weights


def _digest(model: ViTModel) -> str:
    known: str | None = getattr(model, "sgbd_digest", None)
    if known is None:
        digest = hashlib.sha256()
        for name, tensor in sorted(model.state_dict().items()):
            digest.update(name.encode())
            digest.update(tensor.cpu().contiguous().numpy().tobytes())
        known = model.sgbd_digest = digest.hexdigest()
    return known
