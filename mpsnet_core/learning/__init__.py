"""Training of the networks, and evaluation of all models."""
