"""Graph files: lossless storage of a graph as plain tensors in safetensors format, without executable content.

Redundant values are stored once, and in the smallest dtype:

- integers, and floats with small integer values, are stored in the smallest dtype that restores every value;
- the second half of `edge_index` is left out if it is the reverse of the first;
- the second half of `edge_attr` is stored only in the columns where the two directions differ;
- `edge_label_index` is left out if it equals the first half of `edge_index`.

The metadata records these steps, so that reading can undo them.
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

if TYPE_CHECKING:  # imported when graphs are read; writing needs neither, so workers do not load them
    from torch import Tensor
    from torch_geometric.data import Data

FORMAT_VERSION = 1
"""Increased whenever old files would be misread, or the same frames give different graphs."""

SUFFIX = ".safetensors"

_METADATA = "graph"  # one key only: safetensors does not keep the order of keys, and equal graphs need equal files
_REVERSED, _REVERSED_COLUMNS = "edge_attr.reversed", "edge_attr.reversed_columns"
_NARROW_INTEGERS = (np.uint8, np.int8, np.int16, np.int32)
_NARROW_FLOATS = (np.int8, np.int16)


class GraphFileError(RuntimeError):
    """Raised if a graph file cannot be read or written; the message says which file and what to do."""


@dataclass(frozen=True, slots=True)
class GraphSummary:
    """Summary of a graph, readable from its file without reading the tensors.

    Attributes:
        made_from: Fingerprint of the frame that the graph was built from.
        nodes: Number of superpixels.
        edges: Number of adjacencies.
        merges: Number of adjacencies labelled 1 (merge).
        cuts: Number of adjacencies labelled 0 (cut).
        bytes: Size of the file.
    """

    made_from: str
    nodes: int
    edges: int
    merges: int
    cuts: int
    bytes: int


def write_graph(path: Path, graph: Data | GraphArrays, made_from: str) -> GraphSummary:
    """Write a graph atomically: if writing fails, an existing file stays unchanged.

    Args:
        path: File to write; its folder must exist.
        graph: Graph whose fields are tensors or arrays, strings and plain numbers.
        made_from: Fingerprint of the frame that the graph was built from.

    Returns:
        The summary, which is also stored in the file.

    Raises:
        GraphFileError: If the file cannot be written, for example because the disk is full.
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
        path: File written by `write_graph`.
        fields: Names of the fields to read; None for all. Names of missing fields are ignored.

    Returns:
        The graph as it was written, with the same order of fields, dtypes, shapes and values.

    Raises:
        GraphFileError: If the file is missing, damaged or has another format version.
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
    """Read the summary of a graph file without its tensors.

    Raises:
        GraphFileError: If the file is missing, damaged (or truncated) or has another format version.
    """
    header, size = _read_header(path)
    try:
        return GraphSummary(**header["summary"], bytes=size)
    except (LookupError, TypeError) as error:
        raise _damaged(path, error) from error


def stored_fields(path: Path) -> frozenset[str]:
    """Read the names of the fields in a graph file without its tensors.

    Raises:
        GraphFileError: As in `read_summary`.
    """
    header, _ = _read_header(path)
    try:
        return frozenset(header["fields"])
    except (LookupError, TypeError) as error:
        raise _damaged(path, error) from error


def cannot_write(path: Path, error: OSError) -> str:
    """Return a message that says why a file cannot be written and what to do."""
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
    """Parse the header of a safetensors file: its length in 8 bytes, then JSON with the offsets of every tensor."""
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
    """Remove from `arrays` what the first half of `edge_index` determines; return the names of the affected fields."""
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
            # The two parts may be stored in different narrow dtypes.
            tensor = tensor.to(torch.float32)
            backward = tensor.clone()
            backward[:, stored[_REVERSED_COLUMNS].long()] = stored[_REVERSED].to(torch.float32)
            tensor = torch.cat([tensor, backward])
        # Copy even if the dtype is right already: fields must not share memory.
        values[key] = tensor.to(getattr(torch, entry["dtype"]), copy=key == "edge_label_index")
    return Data.from_dict(values)


def _narrow(array: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Convert an array to the smallest dtype that restores every value bit for bit."""
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
    """View float32 values as integers with the same bits, to distinguish 0 from -0 and to compare NaN as equal."""
    return np.ascontiguousarray(array).view(np.int32)
