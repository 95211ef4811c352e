"""Flat materials: from one photo of cloth, leather or bark that lies flat to textures that repeat without a seam."""
