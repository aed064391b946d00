import copy
import json
import pickle
from pathlib import Path

import pytest
import torch
from torch_geometric.data import Data
from torch_geometric.loader import DataLoader

import sgbd.data
from sgbd.data import GraphCacheError, SuperpixelGraphDataset
from sgbd.features import EDGE_GROUPS, NODE_GROUPS, edge_columns, node_columns
from sgbd.graph import GraphBuilder, build_graph
from sgbd.graph_file import FORMAT_VERSION, GraphFileError
from sgbd.preparation import prepare
from tests.boxes import Boxes, Grid, write_boxes

COUNT = 6


@pytest.fixture(scope="session")
def recipe_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("prepared")
    write_boxes(folder / "data", COUNT)
    write_boxes(folder / "data", 2, "test")
    (folder / "data/test/scene_0/00001.npz").write_bytes(b"")
    for split in ("train", "test"):
        path = prepare(Boxes(folder / "data", split), Grid(), GraphBuilder(), folder / "cache", progress=False)
    return path


def same(a: Data, b: Data) -> bool:
    assert list(a.to_dict()) == list(b.to_dict())
    return all(
        torch.equal(value, b[key]) if isinstance(value, torch.Tensor) else value == b[key]
        for key, value in a.to_dict().items()
    )


def test_items_are_the_graphs_of_the_frames(recipe_folder: Path) -> None:
    dataset = SuperpixelGraphDataset(recipe_folder)
    source = Boxes(recipe_folder.parents[1] / "data")
    assert len(dataset) == COUNT
    assert type(dataset[0]) is Data
    for data, frame in zip(dataset, source, strict=True):
        assert same(data, build_graph(frame, Grid()(frame), category_names=source.category_names))
    assert dataset.names == source.names
    assert dataset.category_names == ("mug", "bowl")
    assert dataset.seen == {"mug"}
    assert dataset.recipe["superpixels"] == {"_target_": "tests.boxes.Grid", "size": 4}
    assert dataset.statistics()["graphs"] == COUNT
    assert dataset.skipped == {}
    assert (dataset.node_channels, dataset.edge_channels) == (dataset[0].x.shape[1], dataset[0].edge_attr.shape[1])


def test_a_root_with_one_recipe_means_that(recipe_folder: Path) -> None:
    dataset = SuperpixelGraphDataset(str(recipe_folder.parent), split="test")
    assert dataset.folder == recipe_folder
    assert dataset.names == ("test/scene_0/00000",)
    assert list(dataset.skipped) == ["test/scene_0/00001"]


@pytest.mark.parametrize("in_memory", [False, True])
def test_groups_choose_columns(recipe_folder: Path, in_memory: bool) -> None:
    full = SuperpixelGraphDataset(recipe_folder)[2]
    dataset = SuperpixelGraphDataset(
        recipe_folder, node_features=["depth", "rgb"], edge_features=[], in_memory=in_memory
    )
    assert (dataset.node_channels, dataset.edge_channels) == (4, 0)
    for _ in range(2):
        data = dataset[2]
        assert torch.equal(data.x, full.x[:, node_columns(["rgb", "depth"])])
        assert data.edge_attr.shape == (full.edge_index.shape[1], 0)
        assert torch.equal(data.edge_index, full.edge_index)
    assert (dataset.node_names, dataset.edge_names) == (("red", "green", "blue", "depth"), ())
    everything = SuperpixelGraphDataset(recipe_folder, node_features=list(NODE_GROUPS), edge_features=list(EDGE_GROUPS))
    assert same(everything[2], full)


def test_unknown_groups_list_the_choices(recipe_folder: Path) -> None:
    with pytest.raises(ValueError, match="unknown node feature group colour; choose from rgb, position"):
        SuperpixelGraphDataset(recipe_folder, node_features=["colour"])
    with pytest.raises(ValueError, match="unknown edge feature group rgb; choose from border"):
        SuperpixelGraphDataset(recipe_folder, edge_features=["rgb"])


@pytest.mark.parametrize("in_memory", [False, True])
@pytest.mark.parametrize("workers", [0, 2])
def test_pyg_batches_it(recipe_folder: Path, in_memory: bool, workers: int) -> None:
    dataset = SuperpixelGraphDataset(recipe_folder, in_memory=in_memory)
    batches = list(DataLoader(dataset, batch_size=4, num_workers=workers))
    assert [batch.num_graphs for batch in batches] == [4, 2]
    graphs = [data for batch in batches for data in batch.to_data_list()]
    assert all(same(a, b) for a, b in zip(graphs, dataset, strict=True))
    batch, second = batches[0], dataset[1]
    assert batch.name == list(dataset.names[:4])
    assert batch.image_size.tolist() == [[24, 32]] * 4
    # All superpixel indices are shifted by the number of superpixels in the preceding graphs.
    place = slice(second.edge_label_index.shape[1], 2 * second.edge_label_index.shape[1])
    assert torch.equal(batch.edge_label_index[:, place], second.edge_label_index + dataset[0].num_nodes)
    assert torch.equal(
        batch.overlap_index[batch.overlap_index >= batch.ptr[-2]] - batch.ptr[-2], dataset[3].overlap_index
    )


def test_subsets(recipe_folder: Path) -> None:
    dataset = SuperpixelGraphDataset(recipe_folder)
    names = dataset.names
    assert dataset[1:4].names == names[1:4]
    assert [data.name for data in dataset[[4, 0]]] == [names[4], names[0]]
    assert dataset[torch.tensor([True, False, True, False, False, False])].names == (names[0], names[2])
    assert sorted(dataset.shuffle().names) == sorted(names)
    assert dataset[1:4][1:].names == names[2:4]
    assert dataset[-1].name == names[-1]


def test_graphs_in_memory_are_read_once_and_shared_with_subsets(
    recipe_folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    read = []
    original = sgbd.data.read_graph
    monkeypatch.setattr(sgbd.data, "read_graph", lambda path, fields: read.append(path) or original(path, fields))
    dataset = SuperpixelGraphDataset(recipe_folder, in_memory=True)
    assert read == [], "lazily"
    subset = dataset[2:]
    for _ in range(3):
        list(subset)
        list(dataset)
    assert len(read) == COUNT
    streamed = SuperpixelGraphDataset(recipe_folder)
    list(streamed)
    list(streamed)
    assert len(read) == 3 * COUNT


def test_what_is_replaced_in_a_graph_in_memory_does_not_stay(recipe_folder: Path) -> None:
    def drop_features(data: Data) -> Data:
        data.x = data.x[:, :1]
        del data.edge_attr
        return data

    dataset = SuperpixelGraphDataset(recipe_folder, in_memory=True, transform=drop_features)
    for _ in range(2):
        assert dataset[0].x.shape[1] == 1
    assert dataset.get(0).x.shape[1] == dataset.node_channels
    assert "edge_attr" in dataset.get(0)


def test_it_can_be_sent_to_other_processes(recipe_folder: Path) -> None:
    dataset = SuperpixelGraphDataset(recipe_folder, node_features=["rgb"], in_memory=True)[1:]
    empty = len(pickle.dumps(dataset))
    expected = list(dataset)
    assert len(pickle.dumps(dataset)) == empty, "the graphs themselves are not sent"
    restored = pickle.loads(pickle.dumps(dataset))
    assert all(same(a, b) for a, b in zip(restored, expected, strict=True))
    assert len(dataset._graphs) == COUNT - 1
    assert copy.copy(dataset).names == dataset.names


def test_fewer_fields(recipe_folder: Path) -> None:
    data = SuperpixelGraphDataset(recipe_folder, fields=["x", "edge_index", "edge_label"], edge_features=["border"])[0]
    assert set(data.keys()) == {"x", "edge_index", "edge_label"}
    assert same(Data(x=data.x), Data(x=SuperpixelGraphDataset(recipe_folder)[0].x))


def copy_of(recipe_folder: Path, target: Path) -> Path:
    target.mkdir(parents=True)
    for path in recipe_folder.rglob("*"):
        if path.is_file():
            (target / path.relative_to(recipe_folder)).parent.mkdir(exist_ok=True)
            (target / path.relative_to(recipe_folder)).write_bytes(path.read_bytes())
    return target


def test_a_missing_or_empty_folder_says_how_to_prepare(tmp_path: Path) -> None:
    with pytest.raises(GraphCacheError, match=r"no such folder\. Make them: python -m sgbd\.prepare dataset="):
        SuperpixelGraphDataset(tmp_path / "none")
    with pytest.raises(GraphCacheError, match=r"holds recipe\.json\. Make them: python -m sgbd\.prepare"):
        SuperpixelGraphDataset(tmp_path)


def test_several_recipes_are_listed(recipe_folder: Path, tmp_path: Path) -> None:
    copy_of(recipe_folder, tmp_path / "boxes-1")
    (copy_of(recipe_folder, tmp_path / "boxes-2") / "test" / "index.json").unlink()
    with pytest.raises(GraphCacheError, match="several recipes") as caught:
        SuperpixelGraphDataset(tmp_path)
    assert f"{tmp_path / 'boxes-1'}  (prepared: test, train)" in str(caught.value)
    assert f"{tmp_path / 'boxes-2'}  (prepared: train)" in str(caught.value)


def test_an_unfinished_or_unknown_split(recipe_folder: Path, tmp_path: Path) -> None:
    folder = copy_of(recipe_folder, tmp_path / "boxes")
    with pytest.raises(GraphCacheError, match="has no split 'validation'; prepared splits: test, train"):
        SuperpixelGraphDataset(folder, split="validation")
    (folder / "train" / "index.json").unlink()
    with pytest.raises(GraphCacheError, match="'train' .* is not finished .*finished splits: test"):
        SuperpixelGraphDataset(folder)


@pytest.mark.parametrize(
    ("key", "value", "message"),
    [
        ("format_version", FORMAT_VERSION + 1, f"have format version {FORMAT_VERSION + 1}; .*Prepare them again"),
        ("node_groups", {"rgb": ["red"]}, "other feature columns than this version of sgbd"),
    ],
)
def test_caches_of_other_versions(recipe_folder: Path, tmp_path: Path, key: str, value: object, message: str) -> None:
    folder = copy_of(recipe_folder, tmp_path / "boxes")
    recipe = json.loads((folder / "recipe.json").read_text())
    (folder / "recipe.json").write_text(json.dumps({**recipe, key: value}))
    with pytest.raises(GraphCacheError, match=message):
        SuperpixelGraphDataset(folder)


def test_a_damaged_recipe_and_a_damaged_graph_are_named(recipe_folder: Path, tmp_path: Path) -> None:
    folder = copy_of(recipe_folder, tmp_path / "boxes")
    graph = folder / "train" / "train__scene_0__00001.safetensors"
    graph.write_bytes(graph.read_bytes()[:-1])
    dataset = SuperpixelGraphDataset(folder)
    assert dataset[0].name == "train/scene_0/00000"
    with pytest.raises(
        GraphFileError, match=r"00001\.safetensors is damaged .*delete it and run the preparation again"
    ):
        dataset[1]
    (folder / "recipe.json").write_text("{")
    with pytest.raises(GraphCacheError, match=r"recipe\.json is not the recipe of prepared graphs"):
        SuperpixelGraphDataset(folder)


def test_every_column_has_a_group() -> None:
    assert node_columns(NODE_GROUPS) == node_columns(None)
    assert edge_columns(EDGE_GROUPS) == edge_columns(None)
