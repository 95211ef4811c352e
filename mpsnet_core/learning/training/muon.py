"""Muon: momentum, orthogonalised matrix by matrix (Jordan et al., 2024), for the weights of convolutions.

:class:`torch.optim.Muon`, from PyTorch 2.9 on, takes no convolutions.
"""

from collections.abc import Iterable
from typing import Any

import torch
from torch import Tensor

# Of the Newton-Schulz iteration, chosen by Jordan for a fast rise from small singular values.
_A, _B, _C = 3.4445, -4.7750, 2.0315
STEPS = 5


class Muon(torch.optim.Optimizer):
    """For parameters of two dimensions and more; those of convolutions count as (maps, channels * side * side).

    lr: as AdamW's; updates are scaled to the root mean square that AdamW's have (Liu et al., "Muon is scalable for LLM
    training", 2025), so that one learning rate does for both. momentum: Nesterov's. dtype: what matrices are
    orthogonalised in; Jordan's own is bfloat16, which halves the time where the processor computes with it.
    """

    def __init__(
        self,
        parameters: Iterable[Tensor],
        lr: float = 1e-3,
        momentum: float = 0.95,
        weight_decay: float = 0.0,
        dtype: torch.dtype = torch.float32,
    ) -> None:
        super().__init__(parameters, {"lr": lr, "momentum": momentum, "weight_decay": weight_decay})
        self.dtype = dtype

    @torch.no_grad()
    def step(self, closure: Any = None) -> Any:
        """One step of the parameters that have gradients."""
        for group in self.param_groups:
            for parameter in group["params"]:
                if parameter.grad is None:
                    continue
                state = self.state[parameter]
                if not state:
                    state["momentum"] = torch.zeros_like(parameter)
                momentum = state["momentum"]
                momentum.lerp_(parameter.grad, 1 - group["momentum"])
                update = parameter.grad.lerp(momentum, group["momentum"])
                matrix = orthogonal(update.flatten(1).to(self.dtype)).to(update.dtype)
                scale = 0.2 * max(matrix.shape) ** 0.5
                parameter.mul_(1 - group["lr"] * group["weight_decay"])
                parameter.add_(matrix.view_as(update), alpha=-group["lr"] * scale)


def orthogonal(matrix: Tensor) -> Tensor:
    """A matrix (M, N) with its singular values brought near one, by a Newton-Schulz iteration."""
    tall = matrix.shape[0] > matrix.shape[1]
    values: Tensor = matrix.T if tall else matrix
    values = values / (values.norm() + 1e-7)
    for _ in range(STEPS):
        square = values @ values.T
        polynomial = torch.addmm(square, square, square, beta=_B, alpha=_C)
        values = torch.addmm(values, polynomial, values, beta=_A)
    return values.T if tall else values
