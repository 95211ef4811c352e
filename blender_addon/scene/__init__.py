"""What a scene holds, as the core takes it: objects, surfaces, cameras, meshes."""
