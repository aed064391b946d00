"""The 25 object categories of the Tabletop Object Dataset and the zero-shot split TOD-Z over them."""

from __future__ import annotations

from sgbd.sources.shapenet import SHAPENET_SYNSETS

TOD_CATEGORIES: tuple[str, ...] = (
    "ashcan",
    "bag",
    "birdhouse",
    "bottle",
    "bowl",
    "camera",
    "can",
    "cap",
    "cellular_telephone",
    "clock",
    "computer_keyboard",
    "dishwasher",
    "display",
    "helmet",
    "jar",
    "knife",
    "laptop",
    "loudspeaker",
    "microwave",
    "mug",
    "pillow",
    "pot",
    "printer",
    "telephone",
    "washer",
)
"""Category names in the order of their ids in a semantic mask, from 1 to 25.

Neither the dataset nor the paper publishes the numbering of the semantic masks. This is the order of the synsets, which
is also alphabetical; pass `sgbd.sources.Tod(category_names=...)` to use a different one.
"""

TOD_SYNSETS: dict[str, str] = {synset: name for synset, name in SHAPENET_SYNSETS.items() if name in TOD_CATEGORIES}
"""Category name by ShapeNetCore synset offset, which is also the folder of the category's meshes."""

TABLE_CATEGORY = len(TOD_CATEGORIES) + 1
"""Id of the table in a semantic mask, 26; 0 is background."""

TOD_GROUPS: dict[str, tuple[str, ...]] = {
    "containers": ("ashcan", "bag", "can", "mug", "bottle", "bowl", "jar", "pot"),
    "cubics": ("microwave", "washer", "dishwasher", "printer"),
    "electronics": (
        "camera",
        "cellular_telephone",
        "clock",
        "loudspeaker",
        "computer_keyboard",
        "display",
        "laptop",
        "telephone",
    ),
    "miscellaneous": ("cap", "pillow", "birdhouse", "helmet", "knife"),
}
"""The four groups of similar categories; in TOD-Z about half of each group is seen (listed first here)."""

TODZ_SEEN: frozenset[str] = frozenset(
    {
        "ashcan",
        "bag",
        "camera",
        "can",
        "cap",
        "cellular_telephone",
        "clock",
        "loudspeaker",
        "microwave",
        "mug",
        "pillow",
        "washer",
    }
)
"""The 12 categories that TOD-Z trains on.

E. P. Örnek et al., "SupeRGB-D: Zero-shot instance segmentation in cluttered indoor environments", IEEE Robotics and
Automation Letters 8(6), 2023, doi:10.1109/LRA.2023.3271527.
"""

TODZ_UNSEEN: frozenset[str] = frozenset(TOD_CATEGORIES) - TODZ_SEEN
"""The 13 categories that occur only in TOD-Z's test frames."""
