"""Camera pose estimation: find the camera of a photo from a mesh of the object.

Uses pairs of image and mesh points (:mod:`.points`) and the photo's estimated normals and mask (:mod:`.refine`), from
an initial pose or without one (:mod:`.search`).
"""
