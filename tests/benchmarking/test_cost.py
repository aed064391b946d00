from __future__ import annotations

from torch.nn import Linear

from sgbd.benchmarking.cost import count_parameters
from sgbd.checkpoint import Checkpoint


def test_all_stages_and_heads_count() -> None:
    first = Checkpoint(Linear(3, 2), Linear(4, 1))  # type: ignore[arg-type]
    second = Checkpoint(Linear(9, 1), None, {}, first)  # type: ignore[arg-type]
    assert count_parameters(first) == 8 + 5
    assert count_parameters(second) == 10 + 8 + 5
