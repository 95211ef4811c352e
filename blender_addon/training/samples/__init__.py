"""Training samples rendered with Cycles: a recipe becomes a scene, and its render a sample."""
