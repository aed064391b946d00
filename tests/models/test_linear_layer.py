import pytest
import torch

from sgbd.models import linear_layer as module
from sgbd.models.linear_layer import LARGE, ROW_STEP, has_wide_vectors, linear_layer

ROWS, INPUTS, OUTPUTS = ROW_STEP, 128, 256
assert ROWS * INPUTS * OUTPUTS >= LARGE


def layer(rows: int = ROWS) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    random = torch.Generator().manual_seed(0)
    sizes = (rows, INPUTS), (OUTPUTS, INPUTS), (OUTPUTS,)
    states, weight, bias = (torch.randn(size, generator=random) for size in sizes)
    return states, weight, bias


def expected(states: torch.Tensor, weight: torch.Tensor, bias: torch.Tensor, relu: bool) -> torch.Tensor:
    exact = states.double() @ weight.double().t() + bias.double()
    return (exact.clamp(min=0) if relu else exact).float()


@pytest.mark.parametrize("relu", [False, True])
@pytest.mark.parametrize("rows", [1, ROWS])
@pytest.mark.parametrize("wide", [False, True])
@torch.inference_mode()
def test_every_library_computes_the_layer(relu: bool, rows: int, wide: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    if wide and not has_wide_vectors():
        pytest.skip("this processor has no AVX-512")
    monkeypatch.setattr(module, "has_wide_vectors", lambda: wide)
    states, weight, bias = layer(rows)
    product = linear_layer(states, weight, bias, relu, torch.empty(rows, OUTPUTS))
    torch.testing.assert_close(product, expected(states, weight, bias, relu), rtol=1e-5, atol=1e-5)


def test_without_memory_gradients_flow() -> None:
    states, weight, bias = layer()
    weight.requires_grad_()
    linear_layer(states, weight, bias, True, None).sum().backward()
    positive = (states @ weight.detach().t() + bias > 0).float()
    torch.testing.assert_close(weight.grad, positive.t() @ states, rtol=1e-4, atol=1e-4)
