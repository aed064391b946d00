"""Frame sources: readers for datasets on disk."""

from sgbd.sources.augmented import Augmented
from sgbd.sources.categories import TOD_CATEGORIES, TOD_GROUPS, TODZ_SEEN, TODZ_UNSEEN
from sgbd.sources.color_depth_recording import ColorDepthRecording
from sgbd.sources.errors import DatasetNotFoundError, FrameReadError, MissingExtraError
from sgbd.sources.folder import Folder
from sgbd.sources.image import read_depth, read_labels, read_rgb
from sgbd.sources.label_rule import LabelRule
from sgbd.sources.mosd import Mosd
from sgbd.sources.ocid import Ocid
from sgbd.sources.osd import Osd
from sgbd.sources.point_cloud import PointCloud, read_point_cloud
from sgbd.sources.reduced import Reduced
from sgbd.sources.source import FrameSource
from sgbd.sources.tod import Tod
from sgbd.sources.tum_recording import TumRecording
from sgbd.sources.video_pair import VideoPair

__all__ = [
    "TODZ_SEEN",
    "TODZ_UNSEEN",
    "TOD_CATEGORIES",
    "TOD_GROUPS",
    "Augmented",
    "ColorDepthRecording",
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
    "Reduced",
    "Tod",
    "TumRecording",
    "VideoPair",
    "read_depth",
    "read_labels",
    "read_point_cloud",
    "read_rgb",
]
