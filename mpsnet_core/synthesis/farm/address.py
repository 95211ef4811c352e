"""Addresses of Dask schedulers: which to trust. A client unpickles messages, so the sender can run any code."""

import re

from mpsnet_core.errors import SettingsError

_LOOPBACK = re.compile(r"(?:[a-z]+://)?(?:localhost|127(?:\.\d+){3}|\[::1\])(?::\d+)?/?")


def is_loopback(address: str) -> bool:
    """Whether the address, by its spelling alone, can only be this machine's."""
    return _LOOPBACK.fullmatch(address) is not None


def check_address(address: str, *, trusted: bool) -> None:
    """Raise SettingsError if the address is not authenticated and the network is not trusted."""
    if not (trusted or is_loopback(address) or address.startswith("tls://")):
        raise SettingsError(
            f"anyone who answers at {address} could run code here; give a tls:// address, whose certificates "
            "prove who it is, or say that all of the network is trusted (--cluster-trusted)"
        )
