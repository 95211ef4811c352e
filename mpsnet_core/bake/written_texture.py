"""The record of a written texture, as a bake returns it and as its JSON holds it."""

from dataclasses import dataclass


@dataclass(frozen=True)
class WrittenTexture:
    """A texture that was written: its files and texture set, and what the views saw of it."""

    output: str
    """File of the texture."""
    seen: float
    """Fraction of its surface that some view saw."""
    filled: float | None
    """Fraction of its surface that was filled; None without filling."""
    texels: int
    """Number of texels with surface under them."""
    tile: int | None
    """Number of its UDIM tile; None if textures are not split by tiles."""
    material: str | None
    """Its material; None if textures are not split by materials."""
    object: str | None
    """Its object; None if textures are not split by objects."""
    albedo: str | None
    """File of the colours, if the views have any."""
    coverage: str | None
    """File of the coverage map, if requested."""
    tiles: str | None
    """File name of all tiles, with <UDIM>."""
    albedo_tiles: str | None
    """File name of all tiles of the albedo, with <UDIM>."""
    coverage_tiles: str | None
    """File name of all tiles of the coverage map, with <UDIM>."""
