"""Settings of every step: defined once, kept in the scene, taken by the operators."""

from .scene import register, unregister

__all__ = ["register", "unregister"]
