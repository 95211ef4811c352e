"""Calibration: light directions and positions from a mirror ball, the mixing matrix from a grey ball or card.

Points in a photo are (x, y) in pixels from the top left corner, y down, with pixel centres at half-integers. Everything
else is in camera space: x right, y up, z towards the camera, which is at the origin.
"""
