"""Defaults, limits and shared choices of options.

Both the functions that take an option and the operations that describe it to the command line and Blender read them.
"""

from typing import Literal

# Images: the transfer curve of their values, where the object is, and where the green channel of normal maps points.
ENCODINGS = {
    "auto": "linear for float files and camera raw, sRGB for all others, unless the file says otherwise",
    "linear": "twice the value is twice the light",
    "srgb": "as for a screen",
}
MASK = "alpha-or-auto"
Convention = Literal["opengl", "directx"]
CONVENTIONS = {"opengl": "green is up: Blender, glTF, Unity, Godot", "directx": "green is down: Unreal Engine"}

# A lens's 35 mm equivalent focal length, in millimetres: about 8 for a fisheye, a few thousand for a telescope.
MIN_FOCAL, MAX_FOCAL = 1.0, 10_000.0

# Textures: side and padding (by how far UV islands are dilated), in texels, and the highest factor on detail.
TEXTURE_SIZE = 2048
MAX_TEXTURE_SIZE = 16384
MARGIN = 16
MAX_STRENGTH = 2.0

# Levelling: shapes smaller than this fraction of the mesh's size (the diagonal of its bounding box) count as detail.
LEVEL_SCALE = 0.03
MIN_LEVEL_SCALE, MAX_LEVEL_SCALE = 0.01, 1.0

# Sequences: a frame is averaged with at most this many frames before and after it. Memory holds 2 n + 1 frames. No
# object stands still for as long as a second of film.
MAX_SMOOTHING = 12

# Heights: the face count of a mesh made from them, the broadest shapes that curvature shows, in pixels, and the width
# of a displacement's broadest bumps, as a fraction of the mesh's size.
FACES = 200_000
MAX_FACES = 10_000_000
CURVATURE_RADIUS = 8
MAX_BUMPS = 10.0

# Flat materials: the side of their images in pixels (the largest takes about 8 GB), the fraction of the tile over which
# opposite borders are blended, and the number of half waves up to which bends are removed.
MIN_MATERIAL_SIZE, MAX_MATERIAL_SIZE = 64, 8192
OVERLAP = 0.2
MIN_OVERLAP, MAX_OVERLAP = 0.05, 0.5
BEND = 4
MAX_BEND = 12
# The model of a flat material that is chosen by what the photo shows.
BY_PHOTO = "auto"
