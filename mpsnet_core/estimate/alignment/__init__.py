"""Where the camera of a photo stood, found by a mesh of what it shows.

From pairs of places in the photo and on the mesh (:mod:`.points`), and from the photo's estimated normals and mask
(:mod:`.refine`), from a rough start or without any (:mod:`.search`).
"""
