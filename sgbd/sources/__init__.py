"""Where frames come from: readers of datasets on disk."""

from sgbd.sources.categories import TOD_CATEGORIES, TOD_GROUPS, TODZ_SEEN, TODZ_UNSEEN
from sgbd.sources.errors import DatasetNotFoundError, FrameReadError
from sgbd.sources.source import FrameSource

__all__ = [
    "TODZ_SEEN",
    "TODZ_UNSEEN",
    "TOD_CATEGORIES",
    "TOD_GROUPS",
    "DatasetNotFoundError",
    "FrameReadError",
    "FrameSource",
]
