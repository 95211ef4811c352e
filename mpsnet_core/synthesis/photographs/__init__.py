"""Photographs of samples: what lights, a camera and its files make of them, anew each time they are read."""
