"""Procedural textures: the colour of a surface point as a function of its position.

A texture is called with points and normals in the object's frame, so that it moves with the object and needs no texture
coordinates. Colours are gamma encoded as in image files, 0 to 1.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from sgbd.sources.synthetic.noise import cell_values, fractal_noise

Floats = npt.NDArray[np.float32]
Color = npt.NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class Texture(ABC):
    """Appearance of a surface.

    Attributes:
        gloss: Strength of highlights, from 0 (matte) to 1 (polished).
    """

    gloss: float = field(default=0.15, kw_only=True)

    @abstractmethod
    def __call__(self, points: Floats, normals: Floats) -> Floats:
        """Return the colour of surface points.

        Args:
            points: float32 [n, 3], metres, in the object's frame.
            normals: float32 [n, 3], unit length, in the object's frame.

        Returns:
            float32 [n, 3], gamma encoded, 0 to 1.
        """


def face_coordinates(points: Floats, normals: Floats) -> Floats:
    """Return the two coordinates [n, 2] along the box face that each normal belongs to.

    On vertical faces the second coordinate is the height.
    """
    axis = np.argmax(np.abs(normals), axis=1)
    first = np.where(axis == 0, points[:, 1], points[:, 0])
    second = np.where(axis == 2, points[:, 1], points[:, 2])
    return np.stack([first, second], axis=1)


@dataclass(frozen=True, eq=False)
class Plain(Texture):
    """One colour with a little grain.

    Attributes:
        color: float32 [3].
        grain: Strength of the grain, relative to the colour.
        scale: Size of the grain, metres.
        seed: Seed of the grain.
    """

    color: Color
    grain: float = 0.05
    scale: float = 0.02
    seed: int = 0

    def __call__(self, points: Floats, normals: Floats) -> Floats:
        """Return the colour of surface points."""
        if self.grain == 0:
            return np.broadcast_to(self.color, points.shape).astype(np.float32)
        noise = fractal_noise((points / self.scale).astype(np.float32), 2, self.seed)
        return self.color * (1 + np.float32(2 * self.grain) * (noise[:, None] - np.float32(0.5)))


@dataclass(frozen=True, eq=False)
class Speckled(Texture):
    """Two colours mixed by noise: stone, cloth, camouflage.

    Attributes:
        colors: float32 [2, 3].
        scale: Size of the speckles along x, y, z, metres.
        contrast: From 0 (smooth transitions) to 1 (sharp borders).
        seed: Seed of the noise.
    """

    colors: Floats
    scale: tuple[float, float, float]
    contrast: float = 0.5
    seed: int = 0

    def __call__(self, points: Floats, normals: Floats) -> Floats:
        """Return the colour of surface points."""
        noise = fractal_noise((points / np.asarray(self.scale)).astype(np.float32), 4, self.seed)
        steepness = np.float32(2 + 14 * self.contrast)
        mix = np.clip((noise - np.float32(0.5)) * steepness + np.float32(0.5), 0, 1)[:, None]
        return self.colors[0] * (1 - mix) + self.colors[1] * mix


@dataclass(frozen=True, eq=False)
class Stripes(Texture):
    """Parallel bands of colours.

    Attributes:
        colors: float32 [k, 3], repeated.
        direction: float32 [3], unit vector perpendicular to the bands; None for bands by angle around the z axis.
        period: Total width of the k bands, metres, or radians around the axis.
        phase: Offset of the first band, in periods.
    """

    colors: Floats
    direction: Floats | None
    period: float
    phase: float = 0.0

    def __call__(self, points: Floats, normals: Floats) -> Floats:
        """Return the colour of surface points."""
        if self.direction is None:
            along = np.arctan2(points[:, 1], points[:, 0])
        else:
            along = points @ self.direction.astype(np.float32)
        place = (along / np.float32(self.period) + np.float32(self.phase)) % 1
        return self.colors[np.minimum((place * len(self.colors)).astype(np.int64), len(self.colors) - 1)]


@dataclass(frozen=True, eq=False)
class Checks(Texture):
    """A chequered pattern or a woven check.

    Attributes:
        colors: float32 [2, 3].
        size: Side of a square, metres.
        woven: Whether to draw crossing semi-transparent bands instead of alternating squares.
    """

    colors: Floats
    size: float
    woven: bool = False

    def __call__(self, points: Floats, normals: Floats) -> Floats:
        """Return the colour of surface points."""
        cell = np.floor(face_coordinates(points, normals) / np.float32(self.size)).astype(np.int64) & 1
        share = cell.sum(axis=1) / 2 if self.woven else (cell[:, 0] ^ cell[:, 1])
        mix = share.astype(np.float32)[:, None]
        return self.colors[0] * (1 - mix) + self.colors[1] * mix


@dataclass(frozen=True, eq=False)
class Wood(Texture):
    """Wood with grain, in one piece or as boards of varying tint.

    Attributes:
        color: float32 [3].
        along: Axis of the grain, 0 for x, 1 for y, 2 for z.
        board: Width of a board, metres; 0 for one piece.
        length: Length of a board, metres.
        contrast: Strength of the grain.
        seed: Seed of the grain.
    """

    color: Color
    along: int = 0
    board: float = 0.0
    length: float = 1.2
    contrast: float = 0.3
    seed: int = 0

    def __call__(self, points: Floats, normals: Floats) -> Floats:
        """Return the colour of surface points."""
        stretched = points / np.float32(0.012)
        stretched[:, self.along] *= np.float32(0.06)
        grain = fractal_noise(stretched, 3, self.seed)
        wide = points / np.float32(0.09)
        wide[:, self.along] *= np.float32(0.12)
        rings = fractal_noise(wide, 2, self.seed + 7)
        rings = np.abs((rings * np.float32(7)) % 1 - np.float32(0.5)) * 2
        shade = 1 + np.float32(self.contrast) * (np.float32(0.6) * (grain - 0.5) + np.float32(0.25) * (rings - 0.5))
        if self.board > 0:
            across = 1 if self.along == 0 else 0
            row = np.floor(points[:, across] / np.float32(self.board))
            run = points[:, self.along] / np.float32(self.length) + np.float32(0.37) * row
            column = np.floor(run)
            shade = shade * (
                np.float32(0.88)
                + np.float32(0.24) * cell_values(row.astype(np.int64), column.astype(np.int64), seed=self.seed)
            )
            gap = np.minimum(
                _edge_distance(points[:, across], self.board),
                np.minimum(run - column, column + 1 - run) * np.float32(self.length),
            )
            shade = shade * (np.float32(0.72) + np.float32(0.28) * np.clip(gap / np.float32(0.002), 0, 1))
        return self.color * shade[:, None]


@dataclass(frozen=True, eq=False)
class Tiles(Texture):
    """Tiles or bricks with joints.

    Attributes:
        color: float32 [3].
        joint_color: float32 [3].
        size: Size of a tile along the two directions of a face, metres.
        joint: Width of the joints, metres.
        offset: Shift of every other row, in tiles: 0 for tiles, 0.5 for bricks.
        variety: Variation of brightness between tiles.
        seed: Random seed of the brightness of the tiles.
    """

    color: Color
    joint_color: Color
    size: tuple[float, float]
    joint: float = 0.004
    offset: float = 0.0
    variety: float = 0.1
    seed: int = 0

    def __call__(self, points: Floats, normals: Floats) -> Floats:
        """Return the colour of surface points."""
        place = face_coordinates(points, normals)
        row = np.floor(place[:, 1] / np.float32(self.size[1]))
        shifted = place[:, 0] + np.float32(self.offset * self.size[0]) * (row % 2)
        column = np.floor(shifted / np.float32(self.size[0]))
        tint = cell_values(row.astype(np.int64), column.astype(np.int64), seed=self.seed)
        grain = fractal_noise(points / np.float32(0.03), 3, self.seed)
        shade = 1 + np.float32(self.variety) * (tint - 0.5) + np.float32(0.12) * (grain - 0.5)
        gap = np.minimum(_edge_distance(shifted, self.size[0]), _edge_distance(place[:, 1], self.size[1]))
        tile = np.clip(gap / np.float32(self.joint / 2), 0, 1).astype(np.float32)[:, None]
        return self.joint_color * (1 - tile) + self.color * shade.astype(np.float32)[:, None] * tile


@dataclass(frozen=True, eq=False)
class Bands(Texture):
    """Different textures at different heights: a collar, a dipped glaze, a coloured base.

    Attributes:
        textures: The k textures, from bottom to top.
        heights: The k - 1 ascending heights between them, metres.
        axis: Axis of the heights, 0 for x, 1 for y, 2 for z.
    """

    textures: tuple[Texture, ...]
    heights: tuple[float, ...]
    axis: int = 2

    def __call__(self, points: Floats, normals: Floats) -> Floats:
        """Return the colour of surface points."""
        which = np.searchsorted(np.asarray(self.heights, dtype=np.float32), points[:, self.axis])
        colors = np.empty(points.shape, dtype=np.float32)
        for k, texture in enumerate(self.textures):
            inside = which == k
            if inside.any():
                colors[inside] = texture(points[inside], normals[inside])
        return colors


@dataclass(frozen=True, eq=False)
class Printed(Texture):
    """An image on a part, with another texture around it.

    Attributes:
        image: float32 [h, w, 3], 0 to 1.
        base: Texture outside the image.
        mapping: `around` to wrap the image around the z axis, or the face that shows it: `+x`, `-x`, `+y`, `-y`, `+z`,
            `-z`, or `box` for all faces.
        low: Start of the image: (first coordinate, height) on a face, (angle, height) around the axis.
        high: End of the image; around the axis it is repeated if it spans less than a full turn.
    """

    image: Floats
    base: Texture
    mapping: str
    low: tuple[float, float]
    high: tuple[float, float]

    def __call__(self, points: Floats, normals: Floats) -> Floats:
        """Return the colour of surface points."""
        width, height = self.high[0] - self.low[0], self.high[1] - self.low[1]
        if self.mapping == "around":
            place = np.stack([np.arctan2(points[:, 1], points[:, 0]), points[:, 2]], axis=1)
            place[:, 0] = (place[:, 0] - self.low[0]) % np.float32(width) + self.low[0]
            # Lids, bottoms and the insides of hollow objects show no label.
            shown = (normals[:, :2] * points[:, :2]).sum(axis=1) > 0.3 * np.linalg.norm(points[:, :2], axis=1)
        else:
            place = face_coordinates(points, normals)
            shown = np.ones(len(points), dtype=bool)
            if self.mapping != "box":
                axis, sign = "xyz".index(self.mapping[1]), 1 if self.mapping[0] == "+" else -1
                shown = normals[:, axis] * sign > 0.6
                if self.mapping in ("-x", "+y"):
                    # On these two faces, the first coordinate runs to the left when seen from outside.
                    place[:, 0] = self.low[0] + self.high[0] - place[:, 0]
        u = (place[:, 0] - self.low[0]) / np.float32(width)
        v = (self.high[1] - place[:, 1]) / np.float32(height)
        shown &= (u >= 0) & (u < 1) & (v >= 0) & (v < 1)
        colors = np.empty(points.shape, dtype=np.float32)
        if shown.any():
            colors[shown] = _bilinear(self.image, u[shown], v[shown])
        bare = ~shown
        if bare.any():
            colors[bare] = self.base(points[bare], normals[bare])
        return colors


def _bilinear(image: Floats, u: Floats, v: Floats) -> Floats:
    rows, columns = image.shape[:2]
    x = np.clip(u * columns - 0.5, 0, columns - 1.001)
    y = np.clip(v * rows - 0.5, 0, rows - 1.001)
    i, j = y.astype(np.int64), x.astype(np.int64)
    ty, tx = (y - i).astype(np.float32)[:, None], (x - j).astype(np.float32)[:, None]
    top = image[i, j] * (1 - tx) + image[i, j + 1] * tx
    bottom = image[i + 1, j] * (1 - tx) + image[i + 1, j + 1] * tx
    return top * (1 - ty) + bottom * ty


def _edge_distance(place: Floats, period: float) -> Floats:
    """Return the distance from each coordinate to the nearest multiple of the period."""
    within = place % np.float32(period)
    return np.minimum(within, np.float32(period) - within)
