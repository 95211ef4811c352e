"""Arrays: algorithms on images, masks, graphs and vectors, and statistics, that know of no photo."""
