"""Flat materials: seamless textures from one photo of flat cloth, leather or bark."""
