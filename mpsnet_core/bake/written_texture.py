"""The record of a written texture, as a bake returns it and as its JSON holds it."""

from dataclasses import dataclass


@dataclass(frozen=True)
class WrittenTexture:
    """A texture that was written: its files and texture set, and what the views saw of it.

    output: its file. seen, filled: the fractions of its surface that some view saw and that were filled, None without
    filling. texels: number of texels with surface under them. tile, material, object: of the texture set, None where
    textures are not split by them. albedo: file of the colours, if the views have any. coverage: file of the coverage
    map, if requested. tiles, albedo_tiles, coverage_tiles: the file name of all tiles, with <UDIM>.
    """

    output: str
    seen: float
    filled: float | None
    texels: int
    tile: int | None
    material: str | None
    object: str | None
    albedo: str | None
    coverage: str | None
    tiles: str | None
    albedo_tiles: str | None
    coverage_tiles: str | None
