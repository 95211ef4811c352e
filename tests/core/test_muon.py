"""Muon: orthogonal steps, of the size of AdamW's."""

import pytest

torch = pytest.importorskip("torch")

from mpsnet_core.learning.training.muon import Muon, orthogonal


@pytest.mark.parametrize("shape", [(48, 48), (32, 200), (200, 32)])
def test_a_matrix_becomes_nearly_orthogonal_and_keeps_its_directions(shape: tuple[int, int]) -> None:
    matrix = torch.randn(shape, generator=torch.Generator().manual_seed(0))
    found = orthogonal(matrix)
    left, _, right = torch.linalg.svd(matrix, full_matrices=False)
    singular = torch.diag(left.T @ found @ right.T)
    assert singular.min() > 0.6 and singular.max() < 1.3  # Jordan's coefficients leave 0.7 to 1.2
    off = left.T @ found @ right.T - torch.diag(singular)
    assert off.abs().max() < 0.05


def test_a_linear_map_is_learned() -> None:
    generator = torch.Generator().manual_seed(2)
    wanted, weight = torch.randn((40, 40), generator=generator), torch.nn.Parameter(torch.zeros(40, 40))
    optimiser = Muon([weight], lr=0.2)
    for step in range(300):
        optimiser.param_groups[0]["lr"] = 0.2 * (1 - step / 300)
        given = torch.randn((64, 40), generator=generator)
        optimiser.zero_grad()
        (given @ (weight - wanted).T).square().mean().backward()
        optimiser.step()
    assert (weight - wanted).norm() < 0.05 * wanted.norm()
