"""What options are unless given, how far they go, and choices that several share: for the functions that take them, and
for the operations that describe them to the command line and to Blender."""

# Pictures: how their values stand for light, where the object is, and which way the green channel of normals points.
ENCODINGS = {
    "auto": "linear for float files and camera raw, sRGB for all others, unless the file says otherwise",
    "linear": "twice the value is twice the light",
    "srgb": "as for a screen",
}
MASK = "alpha-or-auto"
CONVENTIONS = {"opengl": "green is up: Blender, glTF, Unity, Godot", "directx": "green is down: Unreal Engine"}

# A lens's 35 mm equivalent focal length, in millimetres: fisheyes have some 8, telescopes a few thousand.
LEAST_FOCAL, MOST_FOCAL = 1.0, 10_000.0

# Textures: their side, and by how far the islands' borders are grown, in texels; what detail is multiplied by at most.
TEXTURE_SIZE = 2048
MAX_TEXTURE_SIZE = 16384
MARGIN = 16
MAX_STRENGTH = 2.0

# Levelling: what is smaller than this fraction of the mesh's size (its bounding box's diagonal) is detail.
LEVEL_SCALE = 0.03
MIN_LEVEL_SCALE, MAX_LEVEL_SCALE = 0.01, 1.0

# Sequences: with how many frames before and behind one is averaged at most. Twice as many and one are held in memory; a
# second of film is far more than a thing stands still.
MAX_SMOOTHING = 12

# Heights: how many faces a mesh of them may have, the broadest shapes that curvature shows, in pixels, and the broadest
# bumps of a displacement, as a fraction of the mesh's size.
FACES = 200_000
MAX_FACES = 10_000_000
CURVATURE_RADIUS = 8
MAX_BUMPS = 10.0

# Flat materials: the side of their pictures in pixels (the largest takes about 8 GB), the share of the tile that its
# borders are joined over, and the half waves up to which bends are taken out.
MIN_MATERIAL_SIZE, MAX_MATERIAL_SIZE = 64, 8192
OVERLAP = 0.2
MIN_OVERLAP, MAX_OVERLAP = 0.05, 0.5
BEND = 4
MAX_BEND = 12
