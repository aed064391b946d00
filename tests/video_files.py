"""Small videos for tests, written with PyAV."""

from __future__ import annotations

from pathlib import Path

import numpy as np


def write_video(
    path: Path, images: list[np.ndarray], codec: str, pixels: str, rate: int = 30,
    moments: list[int] | None = None, options: dict[str, str] | None = None,
) -> Path:  # fmt: skip
    """Write a video from RGB images or images in the pixel format; `moments` are time stamps in units of 1 / rate."""
    import av

    with av.open(str(path), "w") as container:
        stream = container.add_stream(codec, rate=rate)
        stream.height, stream.width = images[0].shape[:2]
        stream.pix_fmt = pixels
        stream.options = options or {}
        for place, image in enumerate(images):
            frame = av.VideoFrame.from_ndarray(image, format="rgb24" if image.ndim == 3 else pixels)
            frame.pts = place if moments is None else moments[place]
            container.mux(stream.encode(frame))
        container.mux(stream.encode(None))
    return path


def colors(count: int, shape: tuple[int, int] = (32, 48)) -> list[np.ndarray]:
    """Return gray images; image k has the value 20 k."""
    return [np.full((*shape, 3), 20 * place, np.uint8) for place in range(count)]


def depths(count: int, shape: tuple[int, int] = (32, 48)) -> list[np.ndarray]:
    """Return depth images; image k is 1000 + 100 k everywhere except for one missing corner pixel."""
    images = [np.full(shape, 1000 + 100 * place, np.uint16) for place in range(count)]
    for image in images:
        image[0, 0] = 0
    return images
