from __future__ import annotations

import json
import pickle
import shutil
from pathlib import Path

import numpy as np
import pytest
import torch
from safetensors.torch import load_file, save_file

from sgbd.node_block import MissingWeightsError, NodeBlockError
from tests.vit import HEADS, PATCH, save_small_vit

pytest.importorskip("transformers", reason="the extra sgbd[dino] is not installed")

from sgbd.dino import IMAGE_MEAN, IMAGE_STD, DinoAttention

HEIGHT, WIDTH = 5 * PATCH, 7 * PATCH


@pytest.fixture(scope="module")
def weights(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return save_small_vit(tmp_path_factory.mktemp("vit"))


def images(count: int, height: int = HEIGHT, width: int = WIDTH, seed: int = 0) -> list[np.ndarray]:
    return list(np.random.default_rng(seed).integers(0, 256, (count, height, width, 3), dtype=np.uint8))


def attention_by_hand(folder: Path, image: np.ndarray) -> np.ndarray:
    """Compute the [CLS] attention of the last block from the raw tensors of the file, step by step in float64."""
    tensors = {name: tensor.double().numpy() for name, tensor in load_file(folder / "model.safetensors").items()}
    config = json.loads((folder / "config.json").read_text())
    size, heads, patch = config["hidden_size"], config["num_attention_heads"], config["patch_size"]
    rows, columns = image.shape[0] // patch, image.shape[1] // patch

    def linear(x, name):
        return x @ tensors[f"{name}.weight"].T + tensors[f"{name}.bias"]

    def norm(x, name):
        centered = x - x.mean(-1, keepdims=True)
        scaled = centered / np.sqrt((centered**2).mean(-1, keepdims=True) + config["layer_norm_eps"])
        return scaled * tensors[f"{name}.weight"] + tensors[f"{name}.bias"]

    def softmax(x):
        e = np.exp(x - x.max(-1, keepdims=True))
        return e / e.sum(-1, keepdims=True)

    def gelu(x):
        return torch.nn.functional.gelu(torch.from_numpy(x)).numpy()

    pixels = (image / 255 - np.array(IMAGE_MEAN)) / np.array(IMAGE_STD)
    kernel = tensors["embeddings.patch_embeddings.projection.weight"]
    patches = pixels.reshape(rows, patch, columns, patch, 3).transpose(0, 2, 4, 1, 3).reshape(rows * columns, -1)
    tokens = patches @ kernel.reshape(size, -1).T + tensors["embeddings.patch_embeddings.projection.bias"]
    position = tensors["embeddings.position_embeddings"][0]
    side = round((len(position) - 1) ** 0.5)
    grid = torch.from_numpy(position[1:].reshape(1, side, side, size).transpose(0, 3, 1, 2))
    grid = torch.nn.functional.interpolate(grid, (rows, columns), mode="bicubic", align_corners=False)[0]
    tokens = tokens + grid.numpy().reshape(size, -1).T
    x = np.concatenate([tensors["embeddings.cls_token"][0] + position[:1], tokens])
    for block in range(config["num_hidden_layers"]):
        name = f"encoder.layer.{block}"
        h = norm(x, f"{name}.layernorm_before")
        query, key, value = (
            linear(h, f"{name}.attention.attention.{part}").reshape(len(h), heads, -1).transpose(1, 0, 2)
            for part in ("query", "key", "value")
        )
        attention = softmax(query @ key.transpose(0, 2, 1) / np.sqrt(size // heads))
        mixed = (attention @ value).transpose(1, 0, 2).reshape(len(h), size)
        x = x + linear(mixed, f"{name}.attention.output.dense")
        h = gelu(linear(norm(x, f"{name}.layernorm_after"), f"{name}.intermediate.dense"))
        x = x + linear(h, f"{name}.output.dense")
    return attention[:, 0, 1:].reshape(heads, rows, columns)


def test_the_attention_is_that_of_the_formulas(weights: Path) -> None:
    (image,) = images(1)
    expected = attention_by_hand(weights, image)
    (planes,) = DinoAttention(weights, normalize=False, interpolation="nearest").planes([image])
    assert planes.shape == (HEADS, HEIGHT, WIDTH)
    assert planes.dtype == np.float32
    assert np.allclose(planes[:, ::PATCH, ::PATCH], expected * 35, rtol=1e-4, atol=1e-5)
    assert expected.std() > 1e-3, "heads that attend evenly would hide a mistake"
    blocks = planes.reshape(HEADS, 5, PATCH, 7, PATCH)
    assert (blocks == blocks[:, :, :1, :, :1]).all()


def test_each_head_is_stretched_within_each_image(weights: Path) -> None:
    both = images(2)
    for image, planes in zip(both, DinoAttention(weights, interpolation="nearest").planes(both), strict=True):
        expected = attention_by_hand(weights, image)
        low, high = expected.min((1, 2), keepdims=True), expected.max((1, 2), keepdims=True)
        assert np.allclose(planes[:, ::PATCH, ::PATCH], (expected - low) / (high - low), atol=1e-4)
        assert planes.min((1, 2)).tolist() == [0] * HEADS
        assert planes.max((1, 2)).tolist() == pytest.approx([1] * HEADS)


def test_batches_of_mixed_sizes_give_what_single_images_give(weights: Path) -> None:
    mixed = [*images(3), *images(2, 2 * PATCH, 3 * PATCH), *images(1, seed=1)]
    block = DinoAttention(weights, batch_size=2)
    together = block.planes(mixed)
    for image, planes in zip(mixed, together, strict=True):
        assert planes.shape == (HEADS, *image.shape[:2])
        assert np.allclose(planes, block.planes([image])[0], atol=1e-5)


@pytest.mark.parametrize("size", [(1, 1), (PATCH - 3, 2), (3 * PATCH + 3, 2 * PATCH + 5)])
def test_any_size_is_stretched_to_whole_patches(weights: Path, size: tuple[int, int]) -> None:
    (planes,) = DinoAttention(weights).planes(images(1, *size))
    assert planes.shape == (HEADS, *size)
    assert np.isfinite(planes).all()
    assert planes.min() >= 0
    assert planes.max() <= 1


def test_columns_are_means_over_superpixels(weights: Path) -> None:
    (image,) = images(1)
    label_map = np.random.default_rng(3).integers(0, 6, (HEIGHT, WIDTH)).astype(np.int32)
    block = DinoAttention(weights)
    (planes,) = block.planes([image])
    (x,) = block([image], [label_map])
    assert x.shape == (6, HEADS) == (6, len(block.names))
    assert block.names == ("dino_0", "dino_1", "dino_2")
    for superpixel in range(6):
        assert np.allclose(x[superpixel], planes[:, label_map == superpixel].mean(1), atol=1e-6)


def test_the_weights_and_not_their_place_are_the_key(weights: Path, tmp_path: Path) -> None:
    same = shutil.copytree(weights, tmp_path / "same")
    other = save_small_vit(tmp_path / "other", seed=1)
    key = DinoAttention(weights, batch_size=1, device="cpu").cache_key()
    assert key == DinoAttention(same).cache_key()
    assert key != DinoAttention(other).cache_key()
    assert key != DinoAttention(weights, normalize=False).cache_key()
    assert key != DinoAttention(weights, interpolation="nearest").cache_key()
    json.dumps(key)


def test_a_recipe_makes_the_same_block_and_no_other_weights_pass(weights: Path, tmp_path: Path) -> None:
    recipe = DinoAttention(weights).recipe()
    arguments = {key: value for key, value in recipe.items() if key != "_target_"}
    assert DinoAttention(**arguments).recipe() == recipe
    save_small_vit(tmp_path, seed=1)
    with pytest.raises(NodeBlockError, match="not those that are asked for"):
        DinoAttention(**{**arguments, "weights": tmp_path}).recipe()


def test_it_is_sent_to_processes_without_its_weights(weights: Path) -> None:
    block = DinoAttention(weights)
    before = block.planes(images(1))[0]
    message = pickle.dumps(block)
    assert len(message) < 500
    assert np.array_equal(pickle.loads(message).planes(images(1))[0], before)


def test_missing_weights_say_what_to_give(tmp_path: Path) -> None:
    with pytest.raises(MissingWeightsError, match="a folder with config.json and model.safetensors"):
        DinoAttention(tmp_path / "nowhere").recipe()
    with pytest.raises(MissingWeightsError, match="cannot be read"):
        DinoAttention(tmp_path).recipe()


def test_incomplete_weights_are_refused_not_filled_up(weights: Path, tmp_path: Path) -> None:
    shutil.copytree(weights, tmp_path / "cut")
    tensors = load_file(weights / "model.safetensors")
    del tensors["encoder.layer.1.attention.attention.key.weight"]
    save_file(tensors, tmp_path / "cut" / "model.safetensors", metadata={"format": "pt"})
    with pytest.raises(NodeBlockError, match="no complete ViTModel: 1 tensors are missing"):
        DinoAttention(tmp_path / "cut").recipe()


@pytest.mark.parametrize(
    ("options", "message"),
    [({"interpolation": "cubic"}, "one of bilinear, nearest; got 'cubic'"), ({"batch_size": 0}, "at least 1; got 0")],
)
def test_impossible_options(options: dict, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        DinoAttention("x", **options)


# --- the same columns in training, evaluation and prediction


def test_a_model_trained_with_dino_carries_it(weights: Path, tmp_path: Path) -> None:
    from hydra import compose, initialize_config_dir

    from sgbd.checkpoint import Checkpoint, CheckpointError
    from sgbd.data import SuperpixelGraphDataset
    from sgbd.jobs.configuration import config_folder
    from sgbd.jobs.untrained import untrained_checkpoint
    from sgbd.node_block_cache import prepare_node_block
    from sgbd.preparation import prepare
    from sgbd.segmenter import Segmenter
    from tests.scenes import Scenes

    overrides = ["features=paper_dino", "superpixels.n_segments=12", f"node_block.weights={weights}"]
    with initialize_config_dir(str(config_folder()), version_base="1.3"):
        config = compose("train", overrides)
    checkpoint = untrained_checkpoint(config)
    assert checkpoint.recipe["model"]["node_channels"] == 9 + HEADS
    path = checkpoint.save(tmp_path / "checkpoint.safetensors")

    segmenter = Segmenter.load(path)
    source = Scenes("test")
    folder = prepare(source, segmenter.superpixels, segmenter.graph, tmp_path / "graphs", progress=False)
    prepare_node_block(folder, source, segmenter.node_block, progress=False)
    features = segmenter.recipe["features"]
    graphs = SuperpixelGraphDataset(folder, "test", features["node"], features["edge"])
    for frame, data in zip(source, graphs, strict=True):
        x = segmenter.build_graph(frame, segmenter.superpixels(frame)).x
        assert x.shape[1] == 9 + HEADS
        assert torch.allclose(x, data.x, atol=1e-5)
    assert segmenter.segment_frame(source[0]).instances.shape == source[0].depth.shape

    moved = Path(shutil.move(weights, tmp_path / "moved"))
    try:
        with pytest.raises(MissingWeightsError, match="cannot be read"):
            Segmenter.load(path)
        assert Segmenter.load(path, node_block=DinoAttention(moved)).node_block.weights == str(moved)
        with pytest.raises(CheckpointError, match="trained with the node block"):
            Segmenter.load(path, node_block=DinoAttention(moved, normalize=False))
    finally:
        shutil.move(moved, weights)
    assert Checkpoint.load(path).recipe["features"]["block"]["weights_digest"]


def test_an_experiment_with_dino_alone(weights: Path, tmp_path: Path) -> None:
    from hydra import compose, initialize_config_dir

    from sgbd import Segmenter
    from sgbd.jobs.configuration import config_folder
    from sgbd.jobs.experiment import run_experiment
    from tests.scenes import scene

    overrides = [
        "features=dino",
        "superpixels.n_segments=16",
        "trainer.epochs=1",
        "trainer.progress=false",
        "logger=csv",
    ]
    place = [f"node_block.weights={weights}", f"cache_dir={tmp_path / 'graphs'}", "workers=0", "pictures=0"]
    with initialize_config_dir(str(config_folder()), version_base="1.3"):
        config = compose("train", [*overrides, *place])
    config.dataset = {"_target_": "tests.scenes.Scenes"}
    result = run_experiment(config, tmp_path / "out")
    assert 0 <= result["scores"]["all/overlap_f"] <= 1
    segmenter = Segmenter.load(tmp_path / "out" / result["checkpoint"])
    assert segmenter.model.node_channels == HEADS
    assert np.isfinite(segmenter.segment_frame(scene(0)).edge_probability).all()
