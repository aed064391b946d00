"""Ranges that control how much the scenes of a synthetic dataset vary."""

from __future__ import annotations

from dataclasses import dataclass, replace


@dataclass(frozen=True)
class Variety:
    """Ranges that scenes are drawn from.

    Attributes:
        few: Share of scenes with few objects: at most six.
        floor: Share of scenes on the floor instead of a table.
        packaging: Share of objects that are cartons and rolls, which have no category.
        sundries: Share of the remaining objects that are made-up composite objects, also without a category.
        assemblies: Share of the drawn assemblies (bodies on each other) that are kept; cartons replace the others.
        repeated: Share of objects that look the same as an earlier one.
        stacked: Share of objects dropped upright on another object.
        aligned: Share of the stacked objects that are parallel to the object below.
        beside: Share of objects dropped right beside another object and parallel to it.
        spread: Range of the radius of the area in which objects are dropped, relative to half the square root of their
            total footprint.
        log_spread: Whether the spread is drawn on a logarithmic scale.
        distance: Range of the distance between camera and target, metres.
        elevation: Range of the camera elevation above the horizontal, degrees.
        focal: Range of the focal length, in image widths; None for the default focal length.
    """

    few: float = 0.0
    floor: float = 0.0
    packaging: float = 0.0
    sundries: float = 0.0
    assemblies: float = 1.0
    repeated: float = 0.0
    stacked: float = 0.0
    aligned: float = 0.0
    beside: float = 0.0
    spread: tuple[float, float] = (0.6, 1.1)
    log_spread: bool = False
    distance: tuple[float, float] = (0.7, 1.7)
    elevation: tuple[float, float] = (18, 65)
    focal: tuple[float, float] | None = None


WIDE = Variety(
    few=0.45,
    floor=0.2,
    packaging=0.35,
    stacked=0.25,
    spread=(0.4, 2.6),
    log_spread=True,
    distance=(0.55, 1.8),
    elevation=(16, 72),
    focal=(0.78, 1.08),
)

ASSORTED = replace(WIDE, few=0.35, packaging=0.25, sundries=0.5)

VARIETIES = {
    "tabletop": Variety(),
    "wide": WIDE,
    "assorted": ASSORTED,
    "stacked": replace(
        ASSORTED, few=0.3, packaging=0.3, assemblies=0.4, repeated=0.1, stacked=0.35, aligned=0.5, beside=0.12
    ),
}
"""`tabletop` is clutter as in TOD; `wide` ranges from a single box on the floor to heaps, to train general models;
`assorted` adds made-up objects without a category, about as many as objects with one; `stacked` has more stacks and
rows of packaging and of equal objects, and fewer single objects that look like a stack."""
