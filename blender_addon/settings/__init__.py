"""Settings of every step: defined once, stored in the scene, shared by the operators."""
