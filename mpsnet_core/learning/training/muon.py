"""The Muon optimiser (Jordan et al., 2024) for convolutions: orthogonalised momentum.

:class:`torch.optim.Muon`, available from PyTorch 2.9 on, does not accept convolutions.
"""

from collections.abc import Iterable
from typing import Any

import torch
from torch import Tensor

# Coefficients of the Newton-Schulz iteration, chosen by Jordan to increase small singular values quickly.
_A, _B, _C = 3.4445, -4.7750, 2.0315
STEPS = 5


class Muon(torch.optim.Optimizer):
    """Muon for parameters of two or more dimensions; those of convolutions count as (maps, channels * side * side).

    lr: the same as for AdamW, because updates are scaled to AdamW's RMS (Liu et al., "Muon is scalable for LLM
    training", 2025). momentum: Nesterov's. dtype: of the orthogonalisation; Jordan uses bfloat16, which halves the time
    on hardware that supports it.
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
        """Update the parameters that have gradients."""
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
    """The matrix (M, N) with all singular values near one, by Newton-Schulz iteration."""
    tall = matrix.shape[0] > matrix.shape[1]
    values: Tensor = matrix.T if tall else matrix
    values = values / (values.norm() + 1e-7)
    for _ in range(STEPS):
        square = values @ values.T
        polynomial = torch.addmm(square, square, square, beta=_B, alpha=_C)
        values = torch.addmm(values, polynomial, values, beta=_A)
    return values.T if tall else values
