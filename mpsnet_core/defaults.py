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
