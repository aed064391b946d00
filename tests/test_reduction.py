from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sgbd.frame import Frame, FrameError, Intrinsics
from sgbd.reduction import enlarged, reduced


def frame(height: int = 4, width: int = 5) -> Frame:
    count = height * width
    rgb = np.arange(3 * count).reshape(height, width, 3).astype(np.uint8)
    depth = (1 + np.arange(count, dtype=np.float32) / 100).reshape(height, width)
    return Frame(rgb, depth, Intrinsics(100, 90, 2, 1.5), np.arange(count).reshape(height, width).astype(np.int32))


def test_colours_are_means_and_the_rest_is_that_of_central_pixels() -> None:
    small = reduced(frame(), 2)
    # The squares of the last column are half as wide. Their values are those of columns 4, rows 0 and 1.
    assert small.rgb.shape == (2, 3, 3)
    assert small.rgb[0, 0].tolist() == [9, 10, 11]  # of 0, 3, 15 and 18
    assert small.rgb[0, 2].tolist() == [20, 21, 22]  # of 12 and 27; the half is rounded up
    whole = frame()
    assert small.depth.tolist() == whole.depth[[1, 3]][:, [1, 3, 4]].tolist()
    assert small.instances.tolist() == [[6, 8, 9], [16, 18, 19]]


def test_the_camera_sees_the_same_points() -> None:
    camera, small = frame().camera, reduced(frame(), 2).camera
    # The left edge of the image is at column -1/2 for both.
    assert (-0.5 - small.cx) / small.fx == pytest.approx((-0.5 - camera.cx) / camera.fx)
    # The second column of the small image covers columns 2 and 3, whose centre is 2.5.
    assert (1 - small.cx) / small.fx == pytest.approx((2.5 - camera.cx) / camera.fx)
    assert (0 - small.cy) / small.fy == pytest.approx((0.5 - camera.cy) / camera.fy)


def test_an_unknown_camera_stays_the_assumed_one() -> None:
    unknown = replace(frame(6, 8), intrinsics=None)
    assert reduced(unknown, 2).camera == Intrinsics.default(4, 3)


@given(st.integers(1, 9), st.integers(1, 9), st.integers(1, 10))
def test_sizes_fit_and_every_pixel_gets_the_label_of_its_square(height: int, width: int, factor: int) -> None:
    small = reduced(frame(height, width), factor)
    rows, columns = small.depth.shape
    assert (rows, columns) == (-(-height // factor), -(-width // factor))
    labels = np.arange(rows * columns, dtype=np.int32).reshape(rows, columns)
    whole = enlarged(labels, factor, height, width)
    expected = [[labels[row // factor, column // factor] for column in range(width)] for row in range(height)]
    assert whole.tolist() == np.array(expected).tolist()
    assert whole.dtype == np.int32


def test_without_depth_at_central_pixels_the_factor_is_too_large() -> None:
    whole = frame()
    depth = np.zeros_like(whole.depth)
    depth[0, 0] = 1
    with pytest.raises(FrameError, match="no depth is left after a reduction by 2; use a smaller one"):
        reduced(replace(whole, depth=depth), 2)
