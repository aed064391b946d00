"""Read the colour, depth and label images of a frame, without guessing, padding or rounding."""

from __future__ import annotations

import io
from numbers import Real
from pathlib import Path

import numpy as np
import numpy.typing as npt
from PIL import Image

from sgbd.frame import MILLIMETERS
from sgbd.sources.errors import FrameReadError

IMAGE_SUFFIXES = (".png", ".jpeg", ".jpg")
"""File suffixes of supported images, in lower case."""

_GRAY_8_BIT = ("1", "L", "P")
_GRAY_DEEP = ("I", "I;16", "I;16B", "I;16L", "I;16N")


def image_files(folder: Path) -> list[Path]:
    """Return the image files of a folder, sorted; hidden ones, such as macOS leaves beside every file, are left out."""
    return sorted(
        path
        for path in folder.iterdir()
        if path.suffix.lower() in IMAGE_SUFFIXES and not path.name.startswith(".") and path.is_file()
    )


def checked_depth_scale(depth_scale: float) -> float:
    """Return the depth scale (metres per unit) as a float if it is valid.

    Raises:
        ValueError: If it is not a positive number.
    """
    # A fraction on the command line is text.
    if not isinstance(depth_scale, Real) or not depth_scale > 0:
        raise ValueError(
            "depth_scale must be positive, a number of metres a unit such as 0.0002 for 5000 units a metre; got "
            f"{depth_scale}"
        )
    return float(depth_scale)


def read_rgb(path: str | Path) -> npt.NDArray[np.uint8]:
    """Read a colour image.

    Grey and palette images are converted to RGB, and an alpha channel is dropped. Orientation metadata is ignored:
    depth and labels have none, and all three images must match pixel by pixel.

    Args:
        path: PNG or JPEG file.

    Returns:
        uint8 [H, W, 3], 0 to 255.

    Raises:
        FrameReadError: If the file is missing, truncated, damaged, neither PNG nor JPEG, or has 16-bit grey values.
    """
    image = _decode(path)
    if image.mode in _GRAY_DEEP or image.mode == "F":
        raise FrameReadError(
            path, "a colour image is expected, this one has 16-bit grey values; are rgb and depth swapped?"
        )
    return np.array(image if image.mode == "RGB" else image.convert("RGB"))


def read_depth(path: str | Path, scale: float = MILLIMETERS) -> npt.NDArray[np.float32]:
    """Read a depth image.

    Args:
        path: PNG file with one 16-bit channel, 0 = missing.
        scale: Metres per unit of the file; 0.001 for millimetres.

    Returns:
        float32 [H, W], metres; 0 = missing.

    Raises:
        FrameReadError: If the file is missing, truncated, damaged, not a PNG, or has 8 bits or several channels.
    """
    image = _decode(path, lossless="depth")
    if image.mode in _GRAY_8_BIT:
        raise FrameReadError(
            path,
            "the depth has 8 bits a pixel, too few for distances (a picture made for viewing?). "
            "Export the sensor's values as 16-bit PNG in millimetres.",
        )
    if image.mode not in _GRAY_DEEP:
        raise FrameReadError(
            path,
            f"the depth has {len(image.getbands())} channels ({image.mode}), a picture of the depth and not the depth. "
            "Export the sensor's values as single-channel 16-bit PNG in millimetres.",
        )
    return np.asarray(image).astype(np.float32) * np.float32(scale)


def read_labels(path: str | Path) -> npt.NDArray[np.int32]:
    """Read a label image: one integer id per pixel.

    Args:
        path: PNG file with one channel of 8 or 16 bits; palette images are read as indices, not as colours.

    Returns:
        int32 [H, W].

    Raises:
        FrameReadError: If the file is missing, truncated, damaged, not a PNG, or has several channels.
    """
    image = _decode(path, lossless="labels")
    if image.mode not in _GRAY_8_BIT and image.mode not in _GRAY_DEEP:
        raise FrameReadError(
            path,
            f"labels need one channel with an integer id a pixel; this image has {len(image.getbands())} "
            f"({image.mode}). Save the ids, or a palette image, instead of colours.",
        )
    return np.asarray(image).astype(np.int32)


def _decode(path: str | Path, lossless: str = "") -> Image.Image:
    """Decode a file completely.

    `lossless` names the content, for error messages, if it must not be stored as JPEG; it is empty for colours.
    """
    try:
        data = Path(path).read_bytes()
    except FileNotFoundError:
        raise FrameReadError(path, "the file does not exist") from None
    except OSError as error:
        raise FrameReadError(path, f"the file cannot be read: {error.strerror or error}") from error
    if not data:
        raise FrameReadError(path, "the file is empty")
    try:
        # Detect the format from the content, so that files with a wrong suffix can be read.
        image = Image.open(io.BytesIO(data), formats=("PNG", "JPEG"))
        if not _complete(data, str(image.format)):
            raise FrameReadError(path, f"the {image.format} file is truncated; copy or download it again")
        if lossless and image.format == "JPEG":
            raise FrameReadError(
                path, f"{lossless} must not be stored as JPEG, which changes the values; use 16-bit or 8-bit PNG"
            )
        image.load()
    except Image.UnidentifiedImageError:
        told = "; depth is read from 16-bit PNG" if lossless == "depth" else ""
        raise FrameReadError(path, f"this is neither a PNG nor a JPEG image{told}") from None
    # Depending on where the data is damaged, Pillow raises different exceptions.
    except (OSError, SyntaxError, ValueError, Image.DecompressionBombError) as error:
        if isinstance(error, FrameReadError):
            raise
        raise FrameReadError(path, f"the image is damaged or truncated ({error}); copy or download it again") from error
    return image


def _complete(data: bytes, image_format: str) -> bool:
    """Return whether the file contains the end-of-image marker.

    Pillow only notices missing pixels, and silently fills them in if a program has set
    `PIL.ImageFile.LOAD_TRUNCATED_IMAGES`. The markers cannot occur in compressed data: JPEG escapes 0xFF there, and the
    PNG marker includes a checksum.
    """
    if image_format == "PNG":
        return data.rfind(b"IEND\xaeB`\x82") >= 0
    return data.rfind(b"\xff\xd9") > data.rfind(b"\xff\xda")
