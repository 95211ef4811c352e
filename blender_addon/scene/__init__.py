"""Scene data in the core's form: objects, surfaces, cameras, meshes."""
