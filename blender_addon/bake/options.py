"""The core's options for a texture."""

from typing import Any, Literal, TypedDict

from mpsnet_core.bake.presets import check_preset


class Detail(TypedDict, total=False):
    strength: float
    fill: bool
    onto: str
    onto_convention: Literal["opengl", "directx"]
    onto_shown: Literal["auto", "yes", "no"]


class Sampling(TypedDict):
    size: str
    samples: int
    padding: Literal["nearest", "push-pull", "none"]
    margin: int | None
    space: Literal["tangent", "object"]
    convention: Literal["opengl", "directx"]


def sampling(settings: Any) -> Sampling:
    """The core's options for size, samples, padding, space and convention.

    Raises SettingsError if the preset's program cannot show them.
    """
    if settings.preset != "CUSTOM":
        check_preset(settings.preset.lower(), settings.space.lower(), settings.convention.lower())
    return {
        "size": str(settings.size),
        "samples": int(settings.samples),
        "padding": settings.padding.lower().replace("_", "-"),
        "margin": settings.margin if settings.padding == "NEAREST" else None,
        "space": settings.space.lower(),
        "convention": settings.convention.lower(),
    }


def level(settings: Any) -> str:
    """The core's option for the size above which shapes come from the mesh instead of the photo."""
    return f"{settings.level_scale:g}" if settings.level else "off"


def bits(settings: Any, suffix: str) -> int:
    """Bits per channel for a file with that suffix."""
    if settings.bits != "AUTO":
        return int(settings.bits)
    return 32 if suffix == ".exr" else 16
