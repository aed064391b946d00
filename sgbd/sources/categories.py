"""The 25 object categories of the Tabletop Object Dataset and the zero-shot split TOD-Z over them."""

from __future__ import annotations

TOD_SYNSETS: dict[str, str] = {
    "02747177": "ashcan",
    "02773838": "bag",
    "02843684": "birdhouse",
    "02876657": "bottle",
    "02880940": "bowl",
    "02942699": "camera",
    "02946921": "can",
    "02954340": "cap",
    "02992529": "cellular_telephone",
    "03046257": "clock",
    "03085013": "computer_keyboard",
    "03207941": "dishwasher",
    "03211117": "display",
    "03513137": "helmet",
    "03593526": "jar",
    "03624134": "knife",
    "03642806": "laptop",
    "03691459": "loudspeaker",
    "03761084": "microwave",
    "03797390": "mug",
    "03938244": "pillow",
    "03991062": "pot",
    "04004475": "printer",
    "04401088": "telephone",
    "04554684": "washer",
}
"""ShapeNetCore's WordNet synset of each category: the folder that an object's mesh lies in."""

TOD_CATEGORIES: tuple[str, ...] = tuple(TOD_SYNSETS.values())
"""Category names in the order of their ids: the first has id 1 in a semantic mask, the last 25.

Neither the dataset nor the paper publishes the numbering of the semantic masks. This is the order of the synsets, which
is also alphabetical; `sgbd.sources.Tod(category_names=...)` takes another one.
"""

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
"""The four groups of alike categories; TOD-Z draws about half of each as seen (listed first here)."""

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
"""The 13 categories that only TOD-Z's test frames hold."""
