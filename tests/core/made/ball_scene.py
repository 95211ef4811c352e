"""A photo of a mirror ball, and where the ball is in it."""

from mirror_ball import Scene, lamps_around

MIDDLE = (10.0, -5.0, 0.0)

SCENE = Scene([(MIDDLE, 70.0)], lamps_around(MIDDLE, 1e6), (240, 200))

CIRCLE = "130,105,70"
