"""Albedo from a second photo under white light: the surface's colour without light and shadow.

A photo under three coloured lights has three values per pixel, and colour and shape cannot be separated. A photo of the
same pose under white light is the albedo times the shading, ``w = a Σ v_k max(n·l_k, 0)``. Once the normals are known,
dividing by the shading leaves the albedo.

The visibility of each light (``v_k``, 0 to 1) follows from both photos, which show how much of it arrives
(:mod:`mpsnet_core.estimate.white_photo`). Divided by ``n·l_k``, that is smaller than for the other lights where a
shadow blocks the light.

Assumptions: the surface is matt (highlights stay in the albedo, too bright); the three lights are equally bright when
they are white; interreflections are weak.
"""

import os

import numpy as np

from mpsnet_core.arrays.row_bands import bands
from mpsnet_core.arrays.types import F32, Bools
from mpsnet_core.capture.capture import Capture
from mpsnet_core.errors import SettingsError
from mpsnet_core.estimate.distant_lights import bands_with_lights
from mpsnet_core.estimate.white_photo import normalise_by_white_photo
from mpsnet_core.io.from_files import takes_files
from mpsnet_core.io.image import linear_to_srgb
from mpsnet_core.io.image_reading import read_image
from mpsnet_core.io.image_writing import write_image
from mpsnet_core.io.marks import made
from mpsnet_core.io.opening import AnyPath
from mpsnet_core.scene.normal_map import NormalMap

# Lower limit of the shading (a cosine): below, the albedo would be noise. It comes out too dark instead.
MIN_SHADING = 0.1
# Below this cosine, shadows of a light cannot be detected, and it adds little.
GRAZING = 0.1
# A light's visibility, as a share of the most visible light's: below the first, a shadow blocks it; above the second,
# it arrives in full. Normal errors of some degrees stay above; bounced light and noise in shadows stay below.
SHADOW, FULL = 0.2, 0.6
# A shadow is at most this much brighter than the 95th percentile of pixels that all three lights reach.
BRIGHTER = 1.25
# Below this share of its channel's 99th percentile inside the mask, a pixel of the white photo shows no shadows.
DARK = 0.02
# The albedo is scaled to this value at the 99.5th percentile of its brightest channel inside the mask.
BRIGHTEST, BRIGHTEST_PERCENTILE = 0.9, 99.5


@takes_files
def albedo_from_white(capture: Capture, normals: NormalMap) -> F32:
    """Albedo of a matt surface from the capture's white photo.

    Parameters
    ----------
    capture : Capture
        A capture with a white photo. If the rig's lights lit it, shadows of one or two of them are compensated.
    normals : NormalMap
        Normals of the capture, in camera space.

    Returns
    -------
    (H, W, 3) float32
        Linear, zero outside the mask. The scale is relative, because the exposure is unknown: the 99.5th percentile of
        the brightest channel inside the mask is 0.9. Channels keep their proportions: a tint of the light stays in the
        albedo. It is too dark where all light is blocked: the one lamp's, or that of all three lights.

    Raises
    ------
    SettingsError
        If there is no white photo.

    Examples
    --------
    >>> import numpy as np
    >>> from mpsnet_core import Capture, albedo_from_white, estimate_normals, published_rig
    >>> rig, mask = published_rig(), np.ones((2, 2), bool)
    >>> image = np.broadcast_to(rig.directions @ [0.0, 0.0, 1.0], (2, 2, 3))
    >>> capture = Capture(image, mask, rig, white=image * [1.0, 0.5, 0.25])
    >>> np.allclose(albedo_from_white(capture, estimate_normals(capture, "lambertian")), [0.9, 0.45, 0.225])
    True
    """
    if capture.white is None:
        raise SettingsError("the albedo is made from a white photo, and there is none; give one")
    white = np.maximum(capture.white, 0)
    if capture.white_light is None:
        shading = _by_rig(capture, white, normals.vectors)
    else:
        shading = np.maximum(normals.vectors @ capture.white_light.astype(np.float32), 0)
    albedo = white
    for rows in bands(len(albedo)):
        albedo[rows] /= np.maximum(shading[rows, :, None], np.float32(MIN_SHADING))
        albedo[rows][~capture.mask[rows]] = 0
    # Measure the scale on well-lit pixels that are not clipped, if there are any.
    measure = capture.mask & (shading > MIN_SHADING)
    if capture.white_clipped is not None:
        measure &= ~capture.white_clipped.any(axis=-1)
    measured = albedo[measure if measure.any() else capture.mask]
    brightest = float(np.percentile(measured, BRIGHTEST_PERCENTILE, axis=0).max())
    albedo *= np.float32(BRIGHTEST / max(brightest, 1e-9))
    return albedo


def write_albedo(path: AnyPath, albedo: F32, mask: Bools | None = None, *, bits: int | None = None) -> None:
    """Write an albedo: as sRGB clipped at 1, or linear in float files (EXR, 32-bit TIFF).

    Parameters
    ----------
    path : str or path
        The file; its suffix decides the format.
    albedo : (H, W, 3) float32
        Linear.
    mask : (H, W) bool, optional
        Written as alpha.
    bits : int, optional
        Bits per channel; by default 16, in EXR 32.

    Raises
    ------
    InputError
        As in :func:`write_image`.
    """
    linear = bits == 32 or os.fspath(path).lower().endswith(".exr")
    albedo = np.asarray(albedo)
    values = albedo if linear else linear_to_srgb(albedo)
    if mask is not None:
        values = np.concatenate([values, np.asarray(mask, bool)[..., None]], axis=-1)
    space = "lin_rec709_scene" if linear else "sRGB"
    write_image(path, values, bits=bits, color_space=space, description=made("albedo"))


def read_albedo(path: AnyPath) -> F32:
    """Read an albedo map, or any colour image as one.

    Parameters
    ----------
    path : str or path
        The file.

    Returns
    -------
    (H, W, 3) float32
        Linear; NaN where transparent.

    Raises
    ------
    InputError
        If the file is missing, damaged or not a colour image.
    """
    image = read_image(path)
    if image.alpha is None:
        return image.pixels
    return np.where(image.alpha[..., None] > 0.5, image.pixels, np.float32(np.nan))


def _by_rig(capture: Capture, white: F32, normals: F32) -> F32:
    """(H, W) shading by the rig's three lights, without the light that shadows block."""
    cosines = np.empty(normals.shape, np.float32)
    for rows, lights in bands_with_lights(capture):
        cosines[rows] = np.maximum(np.einsum("...ki,...i->...k", lights, normals[rows]), 0)
    shading: F32 = cosines.sum(axis=-1)
    grey = normalise_by_white_photo(capture)
    if grey.white is None:
        return shading
    comparable = _comparable(capture, white) & (cosines > GRAZING)
    arrives = np.ones_like(cosines)
    for rows in bands(len(white)):
        share = np.where(comparable[rows], grey.image[rows] / np.maximum(cosines[rows], GRAZING), 0)
        best = np.maximum(share.max(axis=-1, keepdims=True), np.float32(1e-9))
        found = np.clip((share / best - SHADOW) / (FULL - SHADOW), 0, 1)
        arrives[rows] = np.where(comparable[rows], found, 1)
    lit = (comparable & (arrives == 1)).all(axis=-1)
    if not lit.any():
        return shading
    # A highlight of one light looks like a shadow of the others, but is brighter than pixels lit by all three.
    ceiling = BRIGHTER * np.percentile(white[lit] / shading[lit][:, None], 95, axis=0)
    least = (white / np.maximum(ceiling, 1e-9).astype(np.float32)).max(axis=-1)
    reached: F32 = np.maximum((arrives * cosines).sum(axis=-1), least)
    return np.minimum(reached, shading)


def _comparable(capture: Capture, white: F32) -> Bools:
    """(H, W, 3) whether the photos show how much of a light arrives: not clipped, and not too dark in the white one."""
    bright: Bools = white > DARK * np.percentile(white[capture.mask], 99, axis=0)
    valid = capture.mask[..., None] & ~capture.saturated & bright
    if capture.white_clipped is not None:
        valid &= ~capture.white_clipped
    if not np.array_equal(capture.rig.mixing, np.eye(3)):
        # Unmixing computes each light from all channels.
        valid = np.broadcast_to(valid.all(axis=-1, keepdims=True), valid.shape)
    return valid
