"""The networks, as PyTorch modules: one file each."""

from typing import Any

from mpsnet_core.errors import InputError
from mpsnet_core.learning.training.networks.demultiplexer import Demultiplexer
from mpsnet_core.learning.training.networks.mps_net import MpsNet, MpsNetDense
from mpsnet_core.learning.training.networks.multiscale import Multiscale
from mpsnet_core.learning.training.networks.network import Network, Prediction
from mpsnet_core.learning.training.networks.ps_fcn import PsFcn

__all__ = ["NETWORKS", "Network", "Prediction", "build_network"]

NETWORKS: dict[str, type[Network]] = {
    "demultiplexer": Demultiplexer,
    "mpsnet": MpsNet,
    "mpsnet-dense": MpsNetDense,
    "multiscale": Multiscale,
    "psfcn": PsFcn,
}


def build_network(name: str, options: dict[str, Any] | None = None) -> Network:
    """A network of fresh weights. options: its own, such as the `width` factor.

    Raises InputError where there is no such network or it does not take the options.
    """
    if name not in NETWORKS:
        raise InputError(f"there is no network {name!r}; choose {', '.join(NETWORKS)}")
    try:
        return NETWORKS[name](**(options or {}))
    except (TypeError, ValueError) as error:
        raise InputError(f"network {name} cannot be built with {options}: {error}; mend the recipe") from None
