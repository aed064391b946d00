"""How much the scenes of a synthetic dataset differ from each other."""

from __future__ import annotations

from dataclasses import dataclass, replace


@dataclass(frozen=True)
class Variety:
    """Ranges that scenes are drawn from.

    Attributes:
        few: Share of scenes with few objects, from one to six (or the most that is asked for).
        floor: Share of scenes on the floor, in place of a table.
        packaging: Share of objects that are cartons and rolls, which have no category.
        sundries: Share of the others that are put together from different parts, and have no category either.
        stacked: Share of objects dropped upright on one that lies there already.
        spread: Smallest and largest radius of the place where objects are dropped, in units of the radius of the disc
            with the area of half of their footprints; drawn on a logarithmic scale if `log_spread`.
        log_spread: See `spread`.
        distance: Nearest and farthest camera, metres from what it looks at.
        elevation: Lowest and highest camera above the horizon, degrees.
        focal: Shortest and longest focal length, in widths of the picture; None for the usual one.
    """

    few: float = 0.0
    floor: float = 0.0
    packaging: float = 0.0
    sundries: float = 0.0
    stacked: float = 0.0
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

VARIETIES = {
    "tabletop": Variety(),
    "wide": WIDE,
    "assorted": replace(WIDE, few=0.35, packaging=0.25, sundries=0.5),
}
"""`tabletop` is cluttered like TOD; `wide` goes from one box on a floor to heaps, for a model that meets anything;
`assorted` has as many made-up things without a category among them as things with one."""
