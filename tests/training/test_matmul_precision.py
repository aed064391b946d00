import subprocess
import sys

import pytest
import torch

from sgbd.training import Trainer
from sgbd.training.matmul_precision import PRECISIONS, matmul_precision


@pytest.mark.parametrize("name", PRECISIONS)
def test_the_precision_holds_inside_and_is_set_back(name: str) -> None:
    before = torch.get_float32_matmul_precision()
    inside = []

    def fail() -> None:
        with matmul_precision(name):
            inside.append(torch.get_float32_matmul_precision())
            raise KeyError

    with pytest.raises(KeyError):
        fail()
    assert inside == [name]
    assert torch.get_float32_matmul_precision() == before


@pytest.mark.skipif(not hasattr(torch.backends.mkldnn, "matmul"), reason="this PyTorch has no precision per backend")
def test_the_precision_of_a_single_backend_stays() -> None:
    # In a process of its own: PyTorch cannot go back to the setting for all backends.
    code = (
        "import torch; from sgbd.training.matmul_precision import matmul_precision as context\n"
        "torch.backends.cuda.matmul.fp32_precision = 'tf32'\n"
        "with context('medium'): assert torch.backends.cuda.matmul.fp32_precision == 'tf32'\n"
        "assert torch.backends.cuda.matmul.fp32_precision == 'tf32'"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def test_a_trainer_knows_pytorchs_names() -> None:
    with pytest.raises(ValueError, match="trainer.matmul_precision must be one of highest, high, medium; got 'low'"):
        Trainer(matmul_precision="low")
