"""Heights: what normals say of a surface's shape, and what artists make of it."""
