import torch

from sgbd.models.neighborhood import mean_by, sum_by


def test_sums_and_means_by_group() -> None:
    rows = torch.tensor([[1.0, 2.0], [3.0, 4.0], [5.0, 0.0]])
    group = torch.tensor([2, 0, 2])
    assert sum_by(group, rows, 4).tolist() == [[3, 4], [0, 0], [6, 2], [0, 0]]
    assert mean_by(group, rows, 4).tolist() == [[3, 4], [0, 0], [3, 1], [0, 0]]
