"""Detail added on top of an object's base map, whose relief is kept."""

from dataclasses import replace

import numpy as np
import OpenImageIO as oiio

from mpsnet_core.arrays.rasterize import extend_to_nearest
from mpsnet_core.arrays.row_bands import bands
from mpsnet_core.arrays.types import F32
from mpsnet_core.arrays.unit_vectors import dot, normalised
from mpsnet_core.errors import FormatError, SettingsError
from mpsnet_core.io.from_files import takes_files
from mpsnet_core.io.opening import AnyPath
from mpsnet_core.scene.normal_encoding import Convention, read_vectors
from mpsnet_core.scene.normal_map import OUTWARDS_SHARE
from mpsnet_core.scene.texture import Texture

# Tolerance on the unit length of decoded normals: 8 bits, JPEG and averages of steep gradients change it.
NEARLY_UNIT = 0.1
# The fraction of the pixels other than background that must be normals.
NORMALS_SHARE = 0.6
# Background (black, white, neutral grey, transparent) takes the value of normals up to this many pixels away.
MARGIN = 16


def read_base_map(path: AnyPath, *, convention: Convention = "opengl") -> F32:
    """Read the tangent-space normal map of an object.

    Parameters
    ----------
    path : str or PathLike
        An image of 8 or 16 bits or float, of any size. Row 0 is at v = 1.
    convention : {"opengl", "directx"}
        Whether green points up or down.

    Returns
    -------
    (H, W, 3) float32 array
        Unit vectors; +z where the file has no normals.

    Raises
    ------
    FileError
        If the file cannot be read.
    FormatError
        If it is not a normal map, or is one in object space.
    """
    vectors, alpha = read_vectors(path, convention)
    length = np.empty(vectors.shape[:2], np.float32)
    for rows in bands(len(vectors)):
        length[rows] = np.linalg.norm(np.nan_to_num(vectors[rows]), axis=-1)
    # Normals count even where alpha is 0: alpha may hold gloss or height instead.
    unit = np.abs(length - 1) < NEARLY_UNIT
    # Black and white decode to vectors of length sqrt(3), neutral grey to length 0: background.
    opaque = np.ones(length.shape, bool) if alpha is None else alpha > 0
    filled = unit | (opaque & (length > NEARLY_UNIT) & (length < np.sqrt(3) - NEARLY_UNIT))
    if unit.sum() < NORMALS_SHARE * max(filled.sum(), 1):
        raise FormatError(f"{path} is not a normal map: its colours are not unit vectors 0.5 + 0.5 n; choose another")
    normals = unit & (vectors[..., 2] >= 0)
    if normals.sum() < OUTWARDS_SHARE * unit.sum():
        raise FormatError(
            f"{path} is not in tangent space: many of its normals point inwards; bake it in tangent space"
        )
    for rows in bands(len(vectors)):
        vectors[rows] = np.where(normals[rows, :, None], normalised(vectors[rows]), [0, 0, 1])
    return extend_to_nearest(vectors, normals, MARGIN)


@takes_files
def blend_detail(texture: Texture, base_map: F32) -> Texture:
    """Blend the texture's normals as detail onto the base map.

    Parameters
    ----------
    texture : Texture
        Detail in tangent space. Where it is flat, the result is the base map.
    base_map : (H, W, 3) float32 array
        Unit vectors in tangent space, resampled to the texture's size. Where it is flat, the result is the texture.

    Returns
    -------
    Texture

    Raises
    ------
    SettingsError
        If the texture is not in tangent space.

    Notes
    -----
    Reoriented Normal Mapping (Barré-Brisebois and Hill, "Blending in Detail", 2012).
    """
    check_blending(texture.space)
    base_map = np.asarray(base_map, np.float32)
    height, width = texture.vectors.shape[:2]
    if base_map.shape[:2] != (height, width):
        base_map = resampled(base_map, height, width)
    vectors = np.empty_like(texture.vectors)
    for rows in bands(height):
        vectors[rows] = reoriented(texture.vectors[rows], normalised(base_map[rows]))
    return replace(texture, vectors=vectors)


def check_blending(space: str) -> None:
    """Raise SettingsError if textures in that space cannot be blended."""
    if space != "tangent":
        raise SettingsError("only a texture in tangent space can go on top of an existing map; bake in tangent space")


def reoriented(detail: F32, base: F32) -> F32:
    """Detail (..., 3) turned by the shortest rotation from +z to the base (..., 3); unit vectors in tangent space.

    Reoriented Normal Mapping: Barré-Brisebois and Hill, "Blending in Detail" (2012), its closed form of the rotation,
    r = t (t·u) / t_z - u for t = base + (0, 0, 1) and u = detail with x and y negated.
    """
    t = base + np.array([0, 0, 1], np.float32)
    u = detail * np.array([-1, -1, 1], np.float32)
    along = dot(t, u) / np.maximum(t[..., 2], 1e-6)
    result: F32 = normalised(t * along[..., None] - u)
    return result


def resampled(vectors: F32, height: int, width: int) -> F32:
    """Resample to another size: linear interpolation to enlarge, area means to reduce."""
    region = oiio.ROI(0, width, 0, height, 0, 1, 0, 3)
    result = oiio.ImageBufAlgo.resize(oiio.ImageBuf(np.ascontiguousarray(vectors)), filtername="triangle", roi=region)
    return np.asarray(result.get_pixels(oiio.FLOAT), np.float32)
