"""Parametric shapes of the 25 categories, with random proportions and surfaces."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from sgbd.sources.synthetic.shapes.containers import ashcan, bag, bottle, bowl, can, jar, mug, pot
from sgbd.sources.synthetic.shapes.cubics import dishwasher, microwave, printer, washer
from sgbd.sources.synthetic.shapes.electronics import (
    camera,
    cellular_telephone,
    clock,
    computer_keyboard,
    display,
    laptop,
    loudspeaker,
    telephone,
)
from sgbd.sources.synthetic.shapes.miscellaneous import birdhouse, cap, helmet, knife, pillow
from sgbd.sources.synthetic.shapes.part import Part, Shape, Solid

SHAPES: dict[str, Callable[[np.random.Generator], Shape]] = {
    builder.__name__: builder
    for builder in (
        ashcan,
        bag,
        birdhouse,
        bottle,
        bowl,
        camera,
        can,
        cap,
        cellular_telephone,
        clock,
        computer_keyboard,
        dishwasher,
        display,
        helmet,
        jar,
        knife,
        laptop,
        loudspeaker,
        microwave,
        mug,
        pillow,
        pot,
        printer,
        telephone,
        washer,
    )
}
"""Function of each category that draws one object."""

__all__ = ["SHAPES", "Part", "Shape", "Solid"]
