from __future__ import annotations

import pytest

from sgbd.frame import FrameError, Intrinsics
from sgbd.sources.camera import intrinsics_from, intrinsics_from_view


def test_mappings_intrinsics_and_none() -> None:
    camera = Intrinsics(525, 526, 319.5, 239.5)
    assert intrinsics_from({"fx": 525, "fy": "526", "cx": 319.5, "cy": 239.5}) == camera
    assert intrinsics_from(camera) is camera
    assert intrinsics_from(None) is None


@pytest.mark.parametrize(
    "value", [{"fx": 1, "fy": 1, "cx": 1}, {"fx": 1, "fy": 1, "cx": 1, "cy": 1, "k1": 0}, [1, 1, 1, 1]]
)
def test_missing_and_unknown_values_are_refused(value: object) -> None:
    with pytest.raises(FrameError, match="exactly the values fx, fy, cx, cy"):
        intrinsics_from(value)  # type: ignore[arg-type]


@pytest.mark.parametrize(("fx", "message"), [("wide", "numbers"), (None, "numbers"), (0, "fx > 0")])
def test_unusable_values_are_refused(fx: object, message: str) -> None:
    with pytest.raises(FrameError, match=message):
        intrinsics_from({"fx": fx, "fy": 1, "cx": 1, "cy": 1})


def test_a_right_angle_of_view_has_half_the_height_as_focal_length() -> None:
    camera = intrinsics_from_view(640, 480, 90)
    assert (camera.fx, camera.fy) == pytest.approx((240, 240))
    assert (camera.cx, camera.cy) == (319.5, 239.5)
