"""Hypothesis strategies for label maps and frames, and a slow, obvious check of label maps."""

from __future__ import annotations

from collections import deque

import numpy as np
import numpy.typing as npt
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from sgbd.frame import Frame
from sgbd.superpixels.connect import connected_regions


def shapes(largest: int = 12) -> st.SearchStrategy[tuple[int, ...]]:
    """Draw height and width, from 1 pixel to `largest`."""
    return hnp.array_shapes(min_dims=2, max_dims=2, min_side=1, max_side=largest)


@st.composite
def label_maps(draw: st.DrawFn, largest: int = 12) -> npt.NDArray[np.int32]:
    """Draw maps of 4-connected regions with ids 0..N-1."""
    raw = draw(hnp.arrays(np.int32, shapes(largest), elements=st.integers(0, 3)))
    return connected_regions(raw)


@st.composite
def frames(draw: st.DrawFn, shape: tuple[int, ...], with_instances: bool = False) -> Frame:
    """Draw frames of the given shape with random colours, depth with holes and, optionally, instances."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    depth = rng.uniform(0.3, 4.0, shape).astype(np.float32)
    depth[rng.random(shape) < draw(st.sampled_from([0.0, 0.3, 0.9]))] = 0
    depth[0, 0] = 1.0
    return Frame(
        rgb=rng.integers(0, 256, (*shape, 3), dtype=np.uint8),
        depth=depth,
        instances=rng.integers(-1, 4, shape).astype(np.int32) if with_instances else None,
        name="random",
    )


def is_superpixel_map(label_map: npt.NDArray[np.int32]) -> bool:
    """Return whether the ids are 0..N-1 and each forms one 4-connected region, by flood fill."""
    seen = np.zeros(label_map.shape, bool)
    started: set[int] = set()
    for start in np.ndindex(label_map.shape):
        if seen[start]:
            continue
        region = int(label_map[start])
        if region in started:
            return False
        started.add(region)
        seen[start] = True
        queue = deque([start])
        while queue:
            row, column = queue.popleft()
            for step in ((row - 1, column), (row + 1, column), (row, column - 1), (row, column + 1)):
                inside = 0 <= step[0] < label_map.shape[0] and 0 <= step[1] < label_map.shape[1]
                if inside and not seen[step] and label_map[step] == region:
                    seen[step] = True
                    queue.append(step)
    return started == set(range(len(started)))
