"""Reflectance (BRDFs): principled materials, measured ones (MERL), and fits to measured ones."""

from functools import lru_cache
from pathlib import Path
from typing import Literal, Protocol

import numpy as np

from mpsnet_core.arrays.types import F32, Floats
from mpsnet_core.errors import FileError, FormatError, SettingsError
from mpsnet_core.synthesis.reflectance.measured import MerlFit, MerlTable, read_fits, read_merl
from mpsnet_core.synthesis.reflectance.principled import PrincipledBsdf
from mpsnet_core.synthesis.scene_description import Colour, Material

__all__ = ["MerlFit", "MerlTable", "PrincipledBsdf", "Reflectance", "load_reflectance", "material_names"]

_table = lru_cache(maxsize=16)(read_merl)  # 17 MB each
_fits = lru_cache(maxsize=2)(read_fits)


class Reflectance(Protocol):
    """A BRDF, evaluated at N points.

    Parameters
    ----------
    normals, lights, views : (N, 3)
        Unit vectors: surface normals, directions to the lights, directions to the viewer.
    paint : (N, 3), optional
        Factors of the base colour (principled) or of the reflectance (measured).

    Returns
    -------
    (N, 3) float32
        The BRDF without the cosine, in 1/sr for linear R, G and B. Finite and not negative; 0 where light or viewer are
        below the surface.
    """

    def __call__(self, normals: Floats, lights: Floats, views: Floats, paint: Floats | None = None) -> F32: ...


def load_reflectance(material: Material, merl: str = "") -> Reflectance:
    """Load the reflectance of a material. Files are cached.

    Parameters
    ----------
    material
        Principled, or measured.
    merl
        The folder of ``.binary`` files, or the ``.npz`` of fits, of a measured material.

    Returns
    -------
    Reflectance
        With the material's tint.

    Raises
    ------
    SettingsError
        If the material is measured and `merl` is empty, or a parameter is not finite.
    FileError, FormatError
        If a file is missing or damaged, or lacks the material.

    Examples
    --------
    >>> up = np.array([[0.0, 0.0, 1.0]])
    >>> matt = load_reflectance(Material(base_color=(0.5, 0.5, 0.5), specular=0.0))
    >>> (np.pi * matt(up, up, up)).round(3).tolist()
    [[0.5, 0.5, 0.5]]
    """
    if material.kind == "principled":
        return PrincipledBsdf(material)
    if not merl:
        raise SettingsError(f"the material {material.source!r} is measured; name where measured materials are (merl)")
    if material.kind == "merl":
        return _tinted(_table(str(Path(merl) / material.source)), material.tint)
    fits = _fits(merl)
    if material.source not in fits:
        raise FormatError(f"{merl} has no material {material.source!r}; give the file that the samples began with")
    return _tinted(fits[material.source], material.tint)


def material_names(merl: str) -> list[tuple[Literal["merl", "fit"], str]]:
    """List the measured materials of a folder of ``.binary`` files or an ``.npz`` of fits.

    Returns
    -------
    list of tuple
        :class:`Material`'s kind and source of each, sorted.

    Raises
    ------
    FileError
        If there is no such folder or file, or the folder is empty.
    FormatError
        If the file is no file of fits.
    """
    path = Path(merl)
    if not path.is_dir():
        return [("fit", name) for name in sorted(_fits(merl))]
    entries = (entry for entry in path.iterdir() if entry.suffix == ".binary" and not entry.name.startswith("."))
    names = sorted(entry.name for entry in entries if entry.is_file())
    if not names:
        raise FileError(f"the folder {path} holds no .binary files; choose the one with MERL's materials")
    return [("merl", name) for name in names]


def _tinted(reflectance: Reflectance, tint: Colour) -> Reflectance:
    if tint == (1.0, 1.0, 1.0):
        return reflectance
    factor = np.asarray(tint, np.float32)
    return lambda normals, lights, views, paint=None: reflectance(normals, lights, views, paint) * factor
