"""Normal integration: from normals to heights over the pixels of a photo."""
