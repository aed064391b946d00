"""Objects as whatever stands on the largest plane, from depth alone, without learning."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import ConvexHull, QhullError

from sgbd.baselines.baseline import Baseline
from sgbd.frame import Frame, Intrinsics

Points = npt.NDArray[np.float64]

PLANE_POINTS = 3
"""Number of points that define a plane."""


class PlaneRemoval(Baseline):
    """Finds the supporting plane by RANSAC; the connected components of what stands on it are the objects.

    The classical tabletop pipeline (R. B. Rusu et al., "Close-range scene segmentation and reconstruction of 3D point
    cloud maps for mobile manipulation in domestic environments", IROS 2009, doi:10.1109/IROS.2009.5354683): find the
    plane with the most points (M. A. Fischler, R. C. Bolles, "Random sample consensus", CACM 24(6), 1981,
    doi:10.1145/358669.358692) and fit it to all of them; keep the points above the convex hull of its points; group
    neighbouring pixels without a depth step between them.

    Args:
        tolerance: Distance from the plane up to which a point lies on it, metres, at a depth of one metre. It grows
            with the square of the depth, like the noise of structured light.
        min_height: Smallest distance of an object's point from the plane, metres.
        max_height: Largest distance of an object's point from the plane, metres.
        max_step: Largest depth step between two neighbouring pixels of an object, metres.
        min_area: Smallest object, pixels.
        trials: Number of planes to try.
        seed: Seed of the random planes.

    Raises:
        ValueError: If a number is out of its range.
    """

    decides_objects = True

    def __init__(
        self,
        tolerance: float = 0.01,
        min_height: float = 0.01,
        max_height: float = 0.5,
        max_step: float = 0.01,
        min_area: int = 150,
        trials: int = 300,
        seed: int = 0,
    ) -> None:
        if min(tolerance, max_step) <= 0 or not 0 <= min_height < max_height or min_area < 0 or trials < 1:
            raise ValueError(
                "PlaneRemoval needs tolerance > 0, max_step > 0, 0 <= min_height < max_height, min_area >= 0 and "
                f"trials >= 1; got {tolerance}, {max_step}, {min_height}, {max_height}, {min_area} and {trials}"
            )
        self.tolerance = tolerance
        self.min_height = min_height
        self.max_height = max_height
        self.max_step = max_step
        self.min_area = min_area
        self.trials = trials
        self.seed = seed

    def __call__(self, frame: Frame) -> npt.NDArray[np.int32]:
        """Segment a frame; pixels without depth belong to no object."""
        points = back_projected(frame.depth, frame.camera)
        known = frame.depth > 0
        allowed = self.tolerance * np.maximum(points[..., 2], 1.0) ** 2
        plane = ransac_plane(points[known], allowed[known], self.trials, np.random.default_rng(self.seed))
        if plane is None:
            return np.zeros(frame.depth.shape, np.int32)
        normal, offset = plane
        height = points @ normal + offset
        on_plane = known & (abs(height) <= allowed)
        standing = known & (height > np.maximum(self.min_height, allowed)) & (height < self.max_height)
        standing &= above_hull(points, on_plane, normal)
        return components(frame.depth, standing, self.max_step, self.min_area)


def back_projected(depth: npt.NDArray[np.float32], camera: Intrinsics) -> Points:
    """Return the point of every pixel in camera coordinates.

    Args:
        depth: float32 [H, W], metres, 0 = missing.
        camera: The camera.

    Returns:
        float64 [H, W, 3], metres (X right, Y down, Z forward); the origin if depth is missing.
    """
    rows, columns = np.indices(depth.shape)
    z = depth.astype(np.float64)
    return np.stack([(columns - camera.cx) / camera.fx * z, (rows - camera.cy) / camera.fy * z, z], axis=-1)


def ransac_plane(
    points: Points, allowed: npt.NDArray[np.float64], trials: int, rng: np.random.Generator, sample: int = 5000
) -> tuple[npt.NDArray[np.float64], float] | None:
    """Find the plane with the most points.

    Args:
        points: float64 [N, 3].
        allowed: float64 [N], distance from a plane up to which each point lies on it.
        trials: Number of planes to try, each through three points.
        rng: Chooses the points.
        sample: Number of points that vote.

    Returns:
        The unit normal, towards the origin, and the offset, such that ``points @ normal + offset`` is the distance.
        They are fitted to all points on the best plane. None if there are fewer than three points, or all are
        collinear.
    """
    if len(points) < PLANE_POINTS:
        return None
    corners = points[rng.integers(0, len(points), (trials, PLANE_POINTS))]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    lengths = np.linalg.norm(normals, axis=1)
    normals, corners = normals[lengths > 0], corners[lengths > 0]
    if not len(normals):
        return None
    normals /= lengths[lengths > 0, None]
    offsets = -(normals * corners[:, 0]).sum(1)
    voters = rng.choice(len(points), min(sample, len(points)), replace=False)
    votes = (abs(points[voters] @ normals.T + offsets) <= allowed[voters, None]).sum(0)
    best = int(votes.argmax())
    normal, offset = normals[best], offsets[best]
    # Fit twice, because the first fit moves the plane, which changes the set of points on it.
    for _ in range(2):
        near = points[abs(points @ normal + offset) <= allowed]
        if len(near) < PLANE_POINTS:
            break
        center = near.mean(0)
        _, axes = np.linalg.eigh((near - center).T @ (near - center))
        normal = axes[:, 0]
        offset = -normal @ center
    return (normal, float(offset)) if offset >= 0 else (-normal, -float(offset))


def above_hull(points: Points, on_plane: npt.NDArray[np.bool_], normal: npt.NDArray[np.float64]) -> npt.NDArray:
    """Find the points whose projection along the normal falls inside the convex hull of the plane's points.

    Args:
        points: float64 [H, W, 3].
        on_plane: bool [H, W], points of the plane.
        normal: float64 [3], its unit normal.

    Returns:
        bool [H, W]; False everywhere if the plane's points have no hull.
    """
    # Two axes in the plane. The coordinate axis most perpendicular to the normal gives the best-conditioned product.
    first = np.cross(normal, np.eye(3)[int(abs(normal).argmin())])
    first /= np.linalg.norm(first)
    flat = points @ np.stack([first, np.cross(normal, first)], axis=1)
    try:
        hull = ConvexHull(flat[on_plane])
    except (QhullError, ValueError):
        return np.zeros(on_plane.shape, np.bool_)
    inside = np.ones(on_plane.shape, np.bool_)
    for a, b, c in hull.equations:
        inside &= a * flat[..., 0] + b * flat[..., 1] + c <= 0
    return inside


def components(
    depth: npt.NDArray[np.float32], mask: npt.NDArray[np.bool_], max_step: float, min_area: int
) -> npt.NDArray[np.int32]:
    """Number the connected components of a mask, separated at depth steps.

    Args:
        depth: float32 [H, W], metres.
        mask: bool [H, W], the pixels to group.
        max_step: Largest depth step between two neighbours (side by side, or one above the other) of one component.
        min_area: Smallest component to keep, pixels.

    Returns:
        int32 [H, W], 0 outside the components; components are numbered from 1 in raster order of their first pixel.
    """
    number = np.arange(depth.size).reshape(depth.shape)
    ends = []
    for before, after in ((np.s_[:, :-1], np.s_[:, 1:]), (np.s_[:-1], np.s_[1:])):
        joined = mask[before] & mask[after] & (abs(depth[before] - depth[after]) <= max_step)
        ends.append((number[before][joined], number[after][joined]))
    i, j = np.concatenate(ends, axis=1)
    graph = coo_array((np.ones(len(i), np.bool_), (i, j)), shape=(depth.size, depth.size))
    _, component = connected_components(graph, directed=False)
    # Pixels outside the mask are components of their own.
    area = np.bincount(component, mask.ravel())
    kept = (area >= max(min_area, 1)).nonzero()[0]
    found = np.zeros(len(area), np.int32)
    found[kept] = np.arange(1, len(kept) + 1)
    return np.where(mask, found[component].reshape(mask.shape), 0).astype(np.int32)
