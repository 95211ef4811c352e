"""Training samples rendered with Cycles: a recipe becomes a scene, one render, one sample."""
