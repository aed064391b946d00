"""Where frames come from: readers of datasets on disk."""

from sgbd.sources.categories import TOD_CATEGORIES, TOD_GROUPS, TODZ_SEEN, TODZ_UNSEEN
from sgbd.sources.errors import DatasetNotFoundError, FrameReadError
from sgbd.sources.folder import Folder
from sgbd.sources.image import read_depth, read_labels, read_rgb
from sgbd.sources.label_rule import LabelRule
from sgbd.sources.source import FrameSource
from sgbd.sources.tod import Tod

__all__ = [
    "TODZ_SEEN",
    "TODZ_UNSEEN",
    "TOD_CATEGORIES",
    "TOD_GROUPS",
    "DatasetNotFoundError",
    "Folder",
    "FrameReadError",
    "FrameSource",
    "LabelRule",
    "Tod",
    "read_depth",
    "read_labels",
    "read_rgb",
]
