import errno
import json
import os
from pathlib import Path

import numpy as np
import pytest
import safetensors.torch
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch_geometric.data import Data

from sgbd.graph_file import (
    FORMAT_VERSION,
    GraphFileError,
    GraphSummary,
    read_graph,
    read_summary,
    stored_fields,
    write_graph,
)


def assert_identical(a: Data, b: Data) -> None:
    """Check for identical fields, order, dtypes, shapes and bits (NaN equals NaN, 0 differs from -0)."""
    assert list(a.to_dict()) == list(b.to_dict())
    for key, value in a.to_dict().items():
        if isinstance(value, torch.Tensor):
            assert b[key].dtype == value.dtype, key
            assert b[key].shape == value.shape, key
            assert b[key].contiguous().numpy().tobytes() == value.contiguous().numpy().tobytes(), key
        else:
            assert b[key] == value
            assert type(b[key]) is type(value)


def graph(nodes: int = 4, edges: int = 5, seed: int = 0) -> Data:
    generator = torch.Generator().manual_seed(seed)
    pairs = torch.randint(0, max(nodes, 1), (2, edges), generator=generator)
    forward = torch.randn(edges, 3, generator=generator)
    backward = forward.clone()
    backward[:, 1] = -forward[:, 1]
    return Data(
        x=torch.randn(nodes, 2, generator=generator),
        edge_index=torch.cat([pairs, pairs.flip(0)], dim=1),
        edge_attr=torch.cat([forward, backward]),
        edge_label_index=pairs.clone(),
        edge_label=torch.tensor([1.0, 0.0, -1.0, 1.0, 1.0] * edges)[:edges],
        area=torch.full((nodes,), 300),
        name="scene_1/00002",
    )


@given(
    nodes=st.integers(0, 6),
    edges=st.integers(0, 9),
    mirrored=st.booleans(),
    seed=st.integers(0, 1000),
    integers=st.lists(st.sampled_from([0, -1, 127, 128, 255, 256, -129, 32768, 65536, 2**31, -(2**63), 2**63 - 1])),
    floats=st.lists(st.sampled_from([0.0, -0.0, 1.0, -1.0, 0.5, 127.0, 300.0, 1e9, float("nan"), float("inf")])),
)
@settings(max_examples=60, deadline=None)
def test_a_graph_is_restored_bit_for_bit(
    tmp_path_factory: pytest.TempPathFactory,
    nodes: int,
    edges: int,
    mirrored: bool,
    seed: int,
    integers: list[int],
    floats: list[float],
) -> None:
    data = graph(nodes, edges if nodes else 0, seed)
    if not mirrored and data.edge_index.numel():
        data.edge_index[0, 0] += 1
    data.integers = torch.tensor(integers, dtype=torch.int64)
    data.floats = torch.tensor(floats, dtype=torch.float32)
    data.doubles = torch.tensor(floats, dtype=torch.float64)
    data.mask = torch.tensor([True, False])
    data.bytes_ = torch.arange(256).to(torch.uint8)
    data.scale, data.count, data.flag, data.nothing = 0.1 + 0.2, 3, True, None
    path = tmp_path_factory.mktemp("graph") / "g.safetensors"
    write_graph(path, data, "f")
    # PyG uses None for absent fields.
    assert_identical(data, read_graph(path))


@pytest.mark.parametrize(("forward", "backward"), [(1.0, 0.5), (0.5, 1.0), (1.0, 300.0), (1.0, -1.0)])
def test_edge_features_are_stored_in_other_types_for_the_two_directions(
    tmp_path: Path, forward: float, backward: float
) -> None:
    data = graph()
    data.edge_attr = torch.tensor([forward, backward]).repeat_interleave(5)[:, None].repeat(1, 2)
    data.edge_attr[:, 0] = 1.0
    write_graph(tmp_path / "g.safetensors", data, "f")
    assert_identical(data, read_graph(tmp_path / "g.safetensors"))


def test_which_fields_are_stored_is_read_without_them(tmp_path: Path) -> None:
    write_graph(tmp_path / "g.safetensors", graph(), "f")
    assert stored_fields(tmp_path / "g.safetensors") == set(graph().to_dict())
    with pytest.raises(GraphFileError, match="is missing"):
        stored_fields(tmp_path / "none.safetensors")


def test_what_follows_from_the_rest_is_not_stored(tmp_path: Path) -> None:
    data = graph()
    write_graph(tmp_path / "g.safetensors", data, "f")
    stored = safetensors.torch.load_file(tmp_path / "g.safetensors")
    assert stored["edge_index"].shape == (2, 5)
    assert stored["edge_index"].dtype == torch.uint8
    assert stored["edge_attr"].shape == (5, 3)
    assert stored["edge_attr.reversed"].shape == (5, 1)
    assert stored["area"].dtype == torch.int16
    assert stored["edge_label"].dtype == torch.int8
    assert "edge_label_index" not in stored
    restored = read_graph(tmp_path / "g.safetensors")
    restored.edge_label_index += 1
    assert torch.equal(restored.edge_index, data.edge_index), "the fields must not share memory"


def test_the_same_graph_gives_the_same_bytes(tmp_path: Path) -> None:
    contents = set()
    for number in range(5):
        write_graph(tmp_path / f"{number}.safetensors", graph(), "f")
        contents.add((tmp_path / f"{number}.safetensors").read_bytes())
    assert len(contents) == 1


def test_summary_and_chosen_fields(tmp_path: Path) -> None:
    path = tmp_path / "g.safetensors"
    written = write_graph(path, graph(), "made from this")
    assert written == GraphSummary("made from this", 4, 5, merges=3, cuts=1, bytes=path.stat().st_size)
    assert read_summary(path) == written
    some = read_graph(path, fields=("edge_label_index", "x", "absent"))
    assert sorted(some.keys()) == ["edge_label_index", "x"]
    assert torch.equal(some.edge_label_index, graph().edge_label_index)


@pytest.mark.parametrize("damage", ["empty", "cut", "header", "garbage", "longer"])
def test_a_damaged_file_is_named(tmp_path: Path, damage: str) -> None:
    path = tmp_path / "g.safetensors"
    write_graph(path, graph(), "f")
    content = path.read_bytes()
    path.write_bytes(
        {
            "empty": b"",
            "cut": content[:-3],
            "header": content[:20],
            "garbage": bytes(np.random.default_rng(0).integers(0, 256, 500, np.uint8)),
            "longer": content + b"\0",
        }[damage]
    )
    for read in (read_graph, read_summary):
        with pytest.raises(GraphFileError, match=r"g\.safetensors is damaged .*delete it and run the prep"):
            read(path)


def test_a_missing_file_and_another_version_are_named(tmp_path: Path) -> None:
    with pytest.raises(GraphFileError, match="is missing: run the preparation again"):
        read_graph(tmp_path / "none.safetensors")
    header = {"format_version": FORMAT_VERSION + 1, "summary": {}, "fields": {}, "mirrored": []}
    content = safetensors.torch.save({"x": torch.zeros(1)}, metadata={"graph": json.dumps(header)})
    (tmp_path / "new.safetensors").write_bytes(content)
    with pytest.raises(GraphFileError, match=f"format version {FORMAT_VERSION + 1}; this version of sgbd reads"):
        read_graph(tmp_path / "new.safetensors")


def test_fields_that_need_a_pickle_are_refused(tmp_path: Path) -> None:
    data = graph()
    data.extra = {"a": 1}
    with pytest.raises(TypeError, match="'extra' of the graph is a dict"):
        write_graph(tmp_path / "g.safetensors", data, "f")
    assert list(tmp_path.iterdir()) == []


def test_a_full_disk_is_named_with_the_space_there_is(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(descriptor: int) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(GraphFileError, match=r"cannot write .*g\.safetensors: the disk is full \(\d+ MiB free in"):
        write_graph(tmp_path / "g.safetensors", graph(), "f")
    assert list(tmp_path.iterdir()) == []


def test_a_folder_that_cannot_be_written_is_named(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(GraphFileError, match="Choose a cache folder that can be written"):
        write_graph(tmp_path / "file" / "g.safetensors", graph(), "f")
