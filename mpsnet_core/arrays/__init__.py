"""General algorithms on images, masks, graphs and vectors, and statistics."""
