"""Settings of every step: defined once, stored in the scene, shared by the operators."""

from .scene import register, unregister

__all__ = ["register", "unregister"]
