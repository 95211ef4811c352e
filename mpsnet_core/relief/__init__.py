"""Heights, meshes, curvature and occlusion from normals."""
