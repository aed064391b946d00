"""Reading the three kinds of images of a frame: colours, depth and labels. Nothing is guessed, padded or rounded."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
import numpy.typing as npt
from PIL import Image

from sgbd.frame import MILLIMETERS
from sgbd.sources.errors import FrameReadError

IMAGE_SUFFIXES = (".png", ".jpeg", ".jpg")
"""File name endings of the images that are read, in lower case."""

_GRAY_8_BIT = ("1", "L", "P")
_GRAY_DEEP = ("I", "I;16", "I;16B", "I;16L", "I;16N")


def checked_depth_scale(depth_scale: float) -> float:
    """Return how many metres a unit of a depth image is, if it can be.

    Raises:
        ValueError: If it is not positive.
    """
    if not depth_scale > 0:
        raise ValueError(f"depth_scale must be positive, in metres a unit; got {depth_scale}")
    return depth_scale


def read_rgb(path: str | Path) -> npt.NDArray[np.uint8]:
    """Read a colour image.

    Grey and palette images are turned into colours and an alpha channel is dropped. An orientation noted in the
    file's metadata is not applied: depth and labels carry none, and all three must match pixel by pixel.

    Args:
        path: PNG or JPEG file.

    Returns:
        uint8 [H, W, 3], 0 to 255.

    Raises:
        FrameReadError: If the file is missing, truncated, damaged, neither PNG nor JPEG, or holds 16-bit grey values.
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
        scale: Metres of one unit of the file; 0.001 for millimetres.

    Returns:
        float32 [H, W], metres; 0 = missing.

    Raises:
        FrameReadError: If the file is missing, truncated, damaged, no PNG, or has 8 bits or several channels a pixel.
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
    """Read a label image: one integer id a pixel.

    Args:
        path: PNG file with one channel of 8 or 16 bits; of a palette image the indices are read, not the colours.

    Returns:
        int32 [H, W].

    Raises:
        FrameReadError: If the file is missing, truncated, damaged, no PNG or has several channels.
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
    """Decode a file completely; `lossless` names the content if JPEG's changes of the values would destroy it."""
    try:
        data = Path(path).read_bytes()
    except FileNotFoundError:
        raise FrameReadError(path, "the file does not exist") from None
    except OSError as error:
        raise FrameReadError(path, f"the file cannot be read: {error.strerror or error}") from error
    if not data:
        raise FrameReadError(path, "the file is empty")
    try:
        # Opened by content, so that a misnamed file still reads.
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
    # What Pillow raises for damaged data depends on the place of the damage.
    except (OSError, SyntaxError, ValueError, Image.DecompressionBombError) as error:
        if isinstance(error, FrameReadError):
            raise
        raise FrameReadError(path, f"the image is damaged or truncated ({error}); copy or download it again") from error
    return image


def _complete(data: bytes, image_format: str) -> bool:
    """Tell whether the end of the image is there.

    Pillow only notices missing pixels, and fills them in silently where a program has set
    `PIL.ImageFile.LOAD_TRUNCATED_IMAGES`. The markers cannot occur inside compressed data: JPEG escapes 0xFF there,
    and PNG's holds a checksum.
    """
    if image_format == "PNG":
        return data.rfind(b"IEND\xaeB`\x82") >= 0
    return data.rfind(b"\xff\xd9") > data.rfind(b"\xff\xda")
