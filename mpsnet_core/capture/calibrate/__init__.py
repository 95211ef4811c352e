"""Calibration: where the lights stand, from a mirror ball; how their colours mix, from a grey ball or card.

Points in a photo are (x, y) in pixels from its top left corner, y down, pixel middles at halves. Everything else is
camera space: x right, y up, z towards the camera, which stands at the origin.
"""
