"""Presets: how a normal texture has to be written for the program that will read it.

All of them expect tangent space by MikkTSpace. Sources of the table's values:

- Blender: its Normal Map node assumes green up by default (Blender manual, Normal Map Node); 16 bits, as it
  keeps all that a file holds.
- Unreal Engine: the prefix T_ is from Epic's "Recommended Asset Naming Conventions", the suffix _N from its own content
  and common style guides; green is down (DirectX); normal maps may stay 16-bit until they are compressed (Editor API,
  ConvertTo8bitTextureSource).
- Unity: "Unity uses Y+ normal maps, sometimes known as OpenGL format" (Unity manual, Normal map); the formats that it
  compresses them to, DXT5nm and BC5, have 8 bits a channel.
- Godot: "Godot expects the normal map to use X+, Y+, and Z+ coordinates" (class reference, BaseMaterial3D); of PNG it
  reads 8 bits a channel, whatever the file holds (godotengine/godot, issue 2911); names are in snake_case (its manual,
  Project organization).
- glTF: +Y is up, images are PNG or JPEG (glTF 2.0 specification, 3.9.3 and 3.8.3); 8 bits, as viewers use no more.
"""

import re
from dataclasses import dataclass
from pathlib import Path

from mpsnet_core.defaults import Convention
from mpsnet_core.errors import Choices, SettingsError


@dataclass(frozen=True)
class Preset:
    """A program's requirements for a normal texture.

    Examples
    --------
    >>> PRESETS["unreal"].stem("HeroHead"), PRESETS["godot"].stem("HeroHead")
    ('T_HeroHead_N', 'hero_head_normal')
    """

    label: str
    """Name of the program."""
    convention: Convention
    """Which way green points: up for "opengl", down for "directx"."""
    bits: int
    """Bits per channel."""
    naming: str = "{}_normal"
    """Name of the file without its suffix, with {} for the object's name."""
    suffix: str = ".png"
    """Suffix of the file."""
    lower: bool = False
    """Whether names are in snake_case."""
    strict: bool = False
    """Whether the program has no way to show another space or convention."""

    def stem(self, name: str) -> str:
        """The name of an object's texture, without suffix."""
        return self.naming.format(_snake_case(name) if self.lower else name)


PRESETS = Choices(
    "preset",
    {
        "blender": Preset("Blender", "opengl", 16),
        "unreal": Preset("Unreal Engine", "directx", 16, naming="T_{}_N"),
        "unity": Preset("Unity", "opengl", 8, naming="{}_Normal"),
        "godot": Preset("Godot", "opengl", 8, lower=True),
        "gltf": Preset("glTF", "opengl", 8, strict=True),
    },
)


def check_preset(name: str, space: str, convention: str) -> None:
    """Raise SettingsError if a preset's program cannot show a texture of this space and convention at all."""
    preset = PRESETS[name]
    for given, needed in ((space, "tangent"), (convention, preset.convention)):
        if preset.strict and given != needed:
            raise SettingsError(
                f"{preset.label} shows textures in {needed} alone, not in {given}; choose {needed}, or leave the preset"
            )


def preset_output(preset: Preset, output: str, name: str, suffix: str | None = None) -> Path:
    """The file to write for an object of that name: `output` or, if that is a folder, the preset's file name in it.

    suffix: replaces the preset's suffix. Raises SettingsError if the output has another one.
    """
    suffix = suffix or preset.suffix
    target = Path(output)
    if target.is_dir() or output.endswith(("/", "\\")):
        return target / f"{preset.stem(name)}{suffix}"
    if target.suffix.lower() != suffix:
        ends = f"ends in {target.suffix}" if target.suffix else f"has no ending (for a new folder write {target}/)"
        raise SettingsError(
            f"the preset for {preset.label} writes {suffix}, but {target} {ends}; change the ending, or leave the "
            "preset out"
        )
    return target


def _snake_case(name: str) -> str:
    words = re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "_", name)
    return re.sub(r"[\s.-]+", "_", words).lower()
