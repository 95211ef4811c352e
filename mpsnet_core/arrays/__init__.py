"""Arrays: what images, masks, graphs and statistics need, without knowing what they show."""
