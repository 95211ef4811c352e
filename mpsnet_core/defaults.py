"""What is taken where nothing is told: for the functions, and for the command line and panel that offer them."""

# Textures: their side, and by how far the islands' borders are grown, in texels.
TEXTURE_SIZE = 2048
MARGIN = 16

# Heights: how many faces a mesh of them may have, and the broadest shapes that curvature shows, in pixels.
FACES = 200_000
CURVATURE_RADIUS = 8

# Flat materials: the share of the tile that its borders are joined over, and the half waves up to which bends are
# taken out.
OVERLAP = 0.2
BEND = 4

# Tests of models: the side of synthetic photos in pixels, the views of each mesh, and what is photographed of statues.
SYNTHETIC_SIZE = 256
MESH_VIEWS = 2
STATUE_SIZE = 640
STATUE_SLANT = 30.0
# Of the first light: straight above the camera, where networks turn no picture, and two odd angles.
STATUE_TILTS = (90.0, 107.0, 131.0)
