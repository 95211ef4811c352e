"""Reflectance: how much of the light from one direction a surface sends into another."""
