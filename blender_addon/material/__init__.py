"""Flat materials."""
