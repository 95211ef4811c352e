"""The networks, as PyTorch modules: one file each."""

from typing import Any

from mpsnet_core.errors import SettingsError
from mpsnet_core.learning.training.networks.multiscale import Multiscale
from mpsnet_core.learning.training.networks.network import Network, Prediction
from mpsnet_core.learning.training.networks.published import Demultiplexer, MpsNet, PsFcn

__all__ = ["NETWORKS", "Network", "Prediction", "build_network"]

NETWORKS: dict[str, type[Network]] = {
    "demultiplexer": Demultiplexer,
    "mpsnet": MpsNet,
    "multiscale": Multiscale,
    "psfcn": PsFcn,
}


def build_network(name: str, options: dict[str, Any] | None = None) -> Network:
    """A network with initial weights.

    Parameters
    ----------
    name : str
        A key of :data:`NETWORKS`.
    options : dict, optional
        Constructor arguments of the network, such as the `width` factor.

    Raises
    ------
    SettingsError
        If there is no such network, or it does not take the options.

    Examples
    --------
    >>> network = build_network("mpsnet", {"width": 0.125})
    >>> network.kind, network.patch
    ('patch', 5)
    """
    if name not in NETWORKS:
        raise SettingsError(f"there is no network {name!r}; choose {', '.join(NETWORKS)}")
    try:
        return NETWORKS[name](**(options or {}))
    except (TypeError, ValueError) as error:
        raise SettingsError(f"network {name} cannot be built with {options}: {error}; correct the recipe") from None
