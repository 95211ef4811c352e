"""From captures to normal maps, of photos and of moving things; where a mesh stands in a photo."""
