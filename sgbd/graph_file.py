"""A graph in a file: a PyG `Data` as plain tensors in safetensors format, without executable content, restored exactly.

Redundant values are stored once, in the smallest dtype: integers (and floats with small integer values) in the smallest
dtype that restores every value; only the first half of `edge_index` if the second is its reverse; the second half of
`edge_attr` only in the columns where the two directions differ; `edge_label_index` not at all if it equals the first
half of `edge_index`. The metadata records these steps, so that reading can undo them.
"""

from __future__ import annotations

import errno
import json
import os
import shutil
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
import safetensors
from safetensors.numpy import save

from sgbd.graph_arrays import GraphArrays
from sgbd.machine.atomic_file import write_whole

if TYPE_CHECKING:  # imported where graphs are read: to write them needs neither, and workers hold neither in memory
    from torch import Tensor
    from torch_geometric.data import Data

FORMAT_VERSION = 1
"""Raised whenever graphs in old files would be read wrongly, or the same frames give other graphs."""

SUFFIX = ".safetensors"

_METADATA = "graph"  # one key: safetensors does not keep the order of several, and files must not differ
_REVERSED, _REVERSED_COLUMNS = "edge_attr.reversed", "edge_attr.reversed_columns"
_NARROW_INTEGERS = (np.uint8, np.int8, np.int16, np.int32)
_NARROW_FLOATS = (np.int8, np.int16)


class GraphFileError(RuntimeError):
    """A file that does not hold a readable graph, or cannot be written; the message says which and what to do."""


@dataclass(frozen=True, slots=True)
class GraphSummary:
    """What a graph file tells of its graph without its tensors being read.

    Attributes:
        made_from: Fingerprint of the frame it was made from.
        nodes: Number of superpixels.
        edges: Number of adjacencies.
        merges: Adjacencies labelled 1 (merge).
        cuts: Adjacencies labelled 0 (cut).
        bytes: Size of the file.
    """

    made_from: str
    nodes: int
    edges: int
    merges: int
    cuts: int
    bytes: int


def write_graph(path: Path, graph: Data | GraphArrays, made_from: str) -> GraphSummary:
    """Write a graph atomically: `path` holds all of it or what it held before.

    Args:
        path: File to write; its folder exists.
        graph: Graph with tensors or arrays, strings and plain numbers as fields.
        made_from: Fingerprint of the frame it was made from.

    Returns:
        The summary that the file also holds.

    Raises:
        GraphFileError: If the file cannot be written, for instance because the disk is full.
        TypeError: If a field is neither a tensor or array nor a string, number, bool or None.
    """
    values: Mapping[str, Any] = graph if isinstance(graph, dict) else graph.to_dict()
    label, pairs, x = (values.get(key) for key in ("edge_label", "edge_label_index", "x"))
    summary = {
        "made_from": made_from,
        "nodes": 0 if x is None else len(x),
        "edges": 0 if pairs is None else int(pairs.shape[1]),
        "merges": 0 if label is None else int((label == 1).sum()),
        "cuts": 0 if label is None else int((label == 0).sum()),
    }
    arrays, fields, mirrored = _encode(values)
    header = {"format_version": FORMAT_VERSION, "summary": summary, "fields": fields, "mirrored": mirrored}
    content = save(arrays, metadata={_METADATA: json.dumps(header)})
    try:
        write_whole(path, content)
    except OSError as error:
        raise GraphFileError(cannot_write(path, error)) from error
    return GraphSummary(**summary, bytes=len(content))  # type: ignore[arg-type]


def read_graph(path: Path, fields: Collection[str] | None = None) -> Data:
    """Read a graph.

    Args:
        path: File of `write_graph`.
        fields: Names of the fields to restore; all of them if None. Fields that the graph lacks are left out.

    Returns:
        The graph as it was written: the same fields in the same order, dtypes, shapes and values.

    Raises:
        GraphFileError: If the file is missing, damaged or of another format version.
    """
    try:
        content = path.read_bytes()
    except OSError as error:
        raise _unreadable(path, error) from error
    from safetensors.torch import load

    header = _parse_header(path, content, len(content))
    try:
        return _decode(header, load(content), fields)
    except (safetensors.SafetensorError, LookupError, ValueError, RuntimeError, TypeError, AttributeError) as error:
        raise _damaged(path, error) from error


def read_summary(path: Path) -> GraphSummary:
    """Read what a graph file tells of its graph, without its tensors.

    Raises:
        GraphFileError: If the file is missing, damaged (also if it is shorter than it should be) or of another format
            version.
    """
    header, size = _read_header(path)
    try:
        return GraphSummary(**header["summary"], bytes=size)
    except (LookupError, TypeError) as error:
        raise _damaged(path, error) from error


def stored_fields(path: Path) -> frozenset[str]:
    """Read which fields the graph of a file has, without its tensors.

    Raises:
        GraphFileError: As in `read_summary`.
    """
    header, _ = _read_header(path)
    try:
        return frozenset(header["fields"])
    except (LookupError, TypeError) as error:
        raise _damaged(path, error) from error


def cannot_write(path: Path, error: OSError) -> str:
    """Say why a file cannot be written and what to do about it."""
    if error.errno in (errno.ENOSPC, errno.EDQUOT):
        folder = next(folder for folder in (path, *path.absolute().parents) if folder.is_dir())
        free = shutil.disk_usage(folder).free / 2**20
        quota = " or the quota is used up" if error.errno == errno.EDQUOT else ""
        return (
            f"cannot write {path}: the disk is full{quota} ({free:.0f} MiB free in {folder}). "
            "Make room or choose another cache folder, and run again: what is prepared is kept."
        )
    return f"cannot write {path}: {error.strerror or error}. Choose a cache folder that can be written."


def _damaged(path: Path, reason: object) -> GraphFileError:
    return GraphFileError(f"{path} is damaged ({reason}): delete it and run the preparation again, which remakes it")


def _unreadable(path: Path, error: OSError) -> GraphFileError:
    if isinstance(error, FileNotFoundError):
        return GraphFileError(f"{path} is missing: run the preparation again, which makes what is not there")
    return GraphFileError(f"{path} cannot be read: {error.strerror or error}")


def _read_header(path: Path) -> tuple[dict[str, Any], int]:
    try:
        with path.open("rb") as file:
            size = os.fstat(file.fileno()).st_size
            start = file.read(8)
            content = start + file.read(min(int.from_bytes(start, "little"), size))
    except OSError as error:
        raise _unreadable(path, error) from error
    return _parse_header(path, content, size), size


def _parse_header(path: Path, content: bytes, size: int) -> dict[str, Any]:
    """Read the header of a safetensors file: its length in 8 bytes, then JSON with the place of every tensor."""
    start = 8 + int.from_bytes(content[:8], "little")
    try:
        layout = json.loads(content[8:start])
        header = json.loads(layout.pop("__metadata__")[_METADATA])
        version = header["format_version"]
        expected = start + max((entry["data_offsets"][1] for entry in layout.values()), default=0)
    except (ValueError, LookupError, TypeError, AttributeError) as error:
        raise _damaged(path, "its header is not that of a graph") from error
    if version != FORMAT_VERSION:
        raise GraphFileError(
            f"{path} has format version {version}; this version of sgbd reads {FORMAT_VERSION}: prepare the graphs anew"
        )
    if size != expected:
        raise _damaged(path, f"{size} bytes instead of {expected}")
    return dict(header)


def _encode(
    values: Mapping[str, Any],
) -> tuple[dict[str, npt.NDArray[Any]], dict[str, dict[str, Any]], list[str]]:
    arrays: dict[str, npt.NDArray[Any]] = {}
    fields: dict[str, dict[str, Any]] = {}
    for key, value in values.items():
        if value is None or isinstance(value, str | bool | int | float):
            fields[key] = {"value": value}
        elif isinstance(value, np.ndarray) or hasattr(value, "detach"):
            arrays[key] = value if isinstance(value, np.ndarray) else value.detach().cpu().numpy()
            fields[key] = {"dtype": arrays[key].dtype.name}
        else:
            raise TypeError(
                f"field {key!r} of the graph is a {type(value).__name__}; only tensors, strings and numbers are stored"
            )
    mirrored = _drop_second_halves(arrays)
    return {key: np.ascontiguousarray(_narrow(array)) for key, array in arrays.items()}, fields, mirrored


def _drop_second_halves(arrays: dict[str, npt.NDArray[Any]]) -> list[str]:
    """Leave out of `arrays` what follows from the first half of `edge_index`; return the names of those fields."""
    both = arrays.get("edge_index")
    if both is None or both.ndim != 2 or both.shape[0] != 2 or both.shape[1] % 2:
        return []
    first, second = np.split(both, 2, axis=1)
    if not np.array_equal(first[::-1], second):
        return []
    mirrored = ["edge_index"]
    arrays["edge_index"] = first
    pairs = arrays.get("edge_label_index")
    if pairs is not None and pairs.dtype == first.dtype and np.array_equal(pairs, first):
        mirrored.append("edge_label_index")
        del arrays["edge_label_index"]
    attributes = arrays.get("edge_attr")
    if (
        attributes is not None
        and attributes.ndim == 2
        and attributes.shape[0] == both.shape[1]
        and attributes.dtype == np.float32
        and len(attributes)
    ):
        mirrored.append("edge_attr")
        forward, backward = np.split(attributes, 2)
        differ = np.flatnonzero((_bits(forward) != _bits(backward)).any(axis=0))
        arrays["edge_attr"] = forward
        arrays[_REVERSED] = backward[:, differ]
        arrays[_REVERSED_COLUMNS] = differ
    return mirrored


def _decode(header: Mapping[str, Any], stored: Mapping[str, Tensor], wanted: Collection[str] | None) -> Data:
    import torch
    from torch_geometric.data import Data

    values: dict[str, Any] = {}
    for key, entry in header["fields"].items():
        if wanted is not None and key not in wanted:
            continue
        if "value" in entry:
            values[key] = entry["value"]
            continue
        mirrored = key in header["mirrored"]
        tensor = stored["edge_index" if mirrored and key == "edge_label_index" else key]
        if mirrored and key == "edge_index":
            tensor = torch.cat([tensor, tensor.flip(0)], dim=1)
        elif mirrored and key == "edge_attr":
            # Each part is as narrow as its own values allow.
            tensor = tensor.to(torch.float32)
            backward = tensor.clone()
            backward[:, stored[_REVERSED_COLUMNS].long()] = stored[_REVERSED].to(torch.float32)
            tensor = torch.cat([tensor, backward])
        # A copy where nothing changes type: fields must not share memory.
        values[key] = tensor.to(getattr(torch, entry["dtype"]), copy=key == "edge_label_index")
    return Data.from_dict(values)


def _narrow(array: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Return the array in the smallest dtype that gives back every value, bit for bit."""
    if array.dtype in (np.int16, np.int32, np.int64):
        if array.size == 0:
            return array.astype(np.int8)
        low, high = int(array.min()), int(array.max())
        for integer in _NARROW_INTEGERS:
            bounds = np.iinfo(integer)
            if bounds.bits < 8 * array.dtype.itemsize and bounds.min <= low <= high <= bounds.max:
                return array.astype(integer)
    elif array.dtype == np.float32:
        for integer in _NARROW_FLOATS:
            bounds = np.iinfo(integer)
            narrow = np.nan_to_num(array, posinf=0, neginf=0).clip(bounds.min, bounds.max).astype(integer)
            if np.array_equal(_bits(narrow.astype(np.float32)), _bits(array)):
                return narrow
    return array


def _bits(array: npt.NDArray[np.float32]) -> npt.NDArray[np.int32]:
    """Return float32 values as the integers that have the same bits, which tell 0 from -0 and compare NaN equal."""
    return np.ascontiguousarray(array).view(np.int32)
