"""Where frames come from: readers of datasets on disk."""

from sgbd.sources.categories import TOD_CATEGORIES, TOD_GROUPS, TODZ_SEEN, TODZ_UNSEEN
from sgbd.sources.errors import DatasetNotFoundError, FrameReadError, MissingExtraError
from sgbd.sources.folder import Folder
from sgbd.sources.image import read_depth, read_labels, read_rgb
from sgbd.sources.label_rule import LabelRule
from sgbd.sources.mosd import Mosd
from sgbd.sources.ocid import Ocid
from sgbd.sources.osd import Osd
from sgbd.sources.point_cloud import PointCloud, read_point_cloud
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
    "MissingExtraError",
    "Mosd",
    "Ocid",
    "Osd",
    "PointCloud",
    "Tod",
    "read_depth",
    "read_labels",
    "read_point_cloud",
    "read_rgb",
]
