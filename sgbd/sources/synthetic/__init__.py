"""The embedded synthetic dataset: parametric objects, rigid-body physics, ray casting, a depth sensor."""

from sgbd.sources.errors import MissingExtraError
from sgbd.sources.synthetic.generation import GenerationError
from sgbd.sources.synthetic.recipe import Recipe
from sgbd.sources.synthetic.tabletop import Tabletop

__all__ = ["GenerationError", "MissingExtraError", "Recipe", "Tabletop"]
