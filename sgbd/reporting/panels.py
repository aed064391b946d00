"""Write and read the gallery of an evaluation: one picture file per panel of a frame, and an index."""

from __future__ import annotations

import io
import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from PIL import Image

from sgbd.frame import SUPPORT, Frame
from sgbd.jobs.configuration import ConfigurationError
from sgbd.machine.atomic_file import write_whole
from sgbd.reporting.overlay import overlay
from sgbd.reporting.plot import draw_edges, with_boundaries
from sgbd.segmentation import Segmentation

GALLERY_FOLDER = "gallery"
INDEX_FILE = "index.json"
PANELS = ("frame", "superpixels", "edges", "prediction", "truth")
"""Names of the panels, in the order of the processing steps."""

SUFFIX = ".webp"
QUALITY = 80
LARGEST_WIDTH = 800
"""Maximum width in pixels; wider pictures are shrunk to keep reports with dozens of them small enough for e-mail."""


@dataclass(frozen=True)
class GalleryFrame:
    """The gallery's entry for a frame.

    Attributes:
        name: Name of the frame.
        panels: File of each existing panel, relative to the gallery folder.
        categories: Category of each object, sorted; empty if unknown.
        seen: Number of objects of seen categories; None without a division into seen and unseen.
        unseen: Number of objects of unseen categories; None without such a division.
        nodes: Content of the panel `superpixels`: superpixels, or segments of a first stage.
    """

    name: str
    panels: Mapping[str, str]
    categories: Sequence[str] = ()
    seen: int | None = None
    unseen: int | None = None
    nodes: str = "superpixels"


def frame_panels(frame: Frame, segmentation: Segmentation) -> dict[str, npt.NDArray[np.uint8]]:
    """Draw the gallery panels of a frame.

    Args:
        frame: The frame.
        segmentation: Its segmentation.

    Returns:
        uint8 [H, W, 3] for each of `PANELS`; without `truth` if the frame has no ground truth.
    """
    panels = {
        "frame": frame.rgb,
        "superpixels": with_boundaries(frame.rgb, segmentation.superpixels),
        "edges": _edges(frame, segmentation),
        "prediction": overlay(frame.rgb, segmentation.instances),
    }
    if frame.instances is not None:
        panels["truth"] = overlay(frame.rgb, frame.instances, first=SUPPORT + 1)
    return panels


def _edges(frame: Frame, segmentation: Segmentation) -> npt.NDArray[np.uint8]:
    dots = 100
    figure = Figure(figsize=(frame.width / dots, frame.height / dots), dpi=dots)
    canvas = FigureCanvasAgg(figure)
    axes = figure.add_axes((0, 0, 1, 1))
    draw_edges(axes, frame, segmentation)
    axes.set_axis_off()
    axes.set_title("")
    canvas.draw()
    return np.asarray(canvas.buffer_rgba())[..., :3].copy()


def write_panels(
    frame: Frame, segmentation: Segmentation, seen: frozenset[str], folder: Path, stem: str
) -> GalleryFrame:
    """Write the panels of a frame as WebP files to a subfolder of the gallery.

    Args:
        frame: The frame.
        segmentation: Its segmentation.
        seen: The dataset's seen categories; empty without a division into seen and unseen.
        folder: The gallery folder.
        stem: Name of the frame's subfolder.

    Returns:
        The frame's entry for the gallery index.
    """
    files = {}
    for panel, picture in frame_panels(frame, segmentation).items():
        files[panel] = f"{stem}/{panel}{SUFFIX}"
        write_whole(folder / files[panel], encoded(Image.fromarray(picture)))
    present = [] if frame.instances is None else np.unique(frame.instances[frame.instances > SUPPORT]).tolist()
    categories = sorted(frame.categories[number] for number in present if number in frame.categories)
    known = sum(category in seen for category in categories)
    return GalleryFrame(
        frame.name,
        files,
        categories,
        seen=known if seen else None,
        unseen=len(categories) - known if seen else None,
        nodes=segmentation.kind_of_nodes,
    )


def encoded(picture: Image.Image, largest_width: int = LARGEST_WIDTH) -> bytes:
    """Encode a picture as WebP, shrinking it if it is wider than `largest_width` pixels."""
    if picture.width > largest_width:
        height = max(1, round(picture.height * largest_width / picture.width))
        picture = picture.resize((largest_width, height), Image.Resampling.LANCZOS)
    content = io.BytesIO()
    picture.convert("RGB").save(content, format="WEBP", quality=QUALITY, method=4)
    return content.getvalue()


def write_index(frames: Sequence[GalleryFrame], folder: Path) -> None:
    """Write the index of a gallery.

    Args:
        frames: The frames, in display order.
        folder: The gallery folder.
    """
    rows = [asdict(frame) for frame in frames]
    write_whole(folder / INDEX_FILE, json.dumps({"frames": rows}, indent=1).encode())


def read_index(folder: Path) -> list[GalleryFrame]:
    """Read the index of a gallery.

    Args:
        folder: The gallery folder.

    Returns:
        The frames; empty if there is no index.

    Raises:
        ConfigurationError: If the index is damaged.
    """
    path = folder / INDEX_FILE
    try:
        return [GalleryFrame(**row) for row in json.loads(path.read_text())["frames"]]
    except FileNotFoundError:
        return []
    except (ValueError, LookupError, TypeError) as error:
        raise ConfigurationError(f"{path} is damaged ({error}); remove it and repeat the evaluation") from None
