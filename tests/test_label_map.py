import numpy as np
import numpy.typing as npt
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from sgbd.label_map import pack, unpack
from tests.label_maps import shapes


@given(hnp.arrays(np.int32, shapes(), elements=st.integers(-1, 100_000)))
def test_round_trip(label_map: npt.NDArray[np.int32]) -> None:
    packed = pack(label_map)
    assert packed.dtype == np.uint8
    restored = unpack(torch.from_numpy(packed), label_map.shape)  # type: ignore[arg-type]
    assert restored.dtype == np.int32
    assert (restored == label_map).all()


def test_another_size_or_other_bytes_are_refused() -> None:
    packed = pack(np.zeros((3, 4), np.int32))
    with pytest.raises(ValueError, match="not a packed label map of 5x4 pixels"):
        unpack(packed, (5, 4))
    with pytest.raises(ValueError, match="not a packed label map"):
        unpack(torch.zeros(9, dtype=torch.uint8), (3, 4))
