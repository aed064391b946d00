"""Write point cloud files byte by byte according to the format description, independently of the tested reader."""

from __future__ import annotations

import struct
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import numpy.typing as npt

KINDS = {"f": "F", "u": "U", "i": "I"}


def lzf(data: bytes) -> bytes:
    """Compress with LZF: a run of one byte as a literal and a reference, the rest as literals of up to 32 bytes."""
    out, literal, place = bytearray(), bytearray(), 0

    def flush() -> None:
        for start in range(0, len(literal), 32):
            piece = literal[start : start + 32]
            out.extend((len(piece) - 1, *piece))
        literal.clear()

    while place < len(data):
        length = 1
        while place + length < len(data) and data[place + length] == data[place] and length < 264:
            length += 1
        literal.append(data[place])
        place += 1
        copied = length - 1
        if copied >= 3:
            flush()
            # A reference: length - 2 in the three upper bits (or 7 and a byte more), distance - 1 = 0 in the rest.
            out.extend(((copied - 2) << 5, 0) if copied - 2 < 7 else (7 << 5, copied - 9, 0))
            place += copied
    flush()
    return bytes(out)


def write_pcd(
    path: Path, columns: Mapping[str, npt.NDArray], height: int, width: int, encoding: str = "binary"
) -> None:
    """Write a file with one field per column, float32, uint32, ..."""
    path.parent.mkdir(parents=True, exist_ok=True)
    arrays = {name: np.asarray(values).ravel() for name, values in columns.items()}
    header = [
        "# .PCD v0.7 - Point Cloud Data file format",
        "VERSION 0.7",
        "FIELDS " + " ".join(arrays),
        "SIZE " + " ".join(str(array.dtype.itemsize) for array in arrays.values()),
        "TYPE " + " ".join(KINDS[array.dtype.kind] for array in arrays.values()),
        "COUNT " + " ".join("1" for _ in arrays),
        f"WIDTH {width}",
        f"HEIGHT {height}",
        "VIEWPOINT 0 0 0 1 0 0 0",
        f"POINTS {height * width}",
        f"DATA {encoding}",
    ]
    if encoding == "ascii":
        rows = zip(*arrays.values(), strict=True)
        body = "".join(" ".join(str(value) for value in row) + "\n" for row in rows).encode()
    elif encoding == "binary":
        body = np.rec.fromarrays(list(arrays.values()), names=list(arrays)).tobytes()
    else:
        plain = b"".join(array.tobytes() for array in arrays.values())
        packed = lzf(plain)
        body = struct.pack("<II", len(packed), len(plain)) + packed
    path.write_bytes("\n".join(header).encode() + b"\n" + body)


def pack_colors(rgb: npt.NDArray[np.uint8]) -> npt.NDArray[np.uint32]:
    """Return the colours packed as in PCL, 0x00RRGGBB."""
    red, green, blue = rgb.reshape(-1, 3).astype(np.uint32).T
    return (red << 16) | (green << 8) | blue
