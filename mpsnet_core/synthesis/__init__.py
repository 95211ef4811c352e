"""Training data: samples drawn from a seed, rendered by Blender's Cycles or synthesised here, and read back.

A :class:`~mpsnet_core.synthesis.recipe.Recipe` states everything that a sample shows, and is drawn from a seed and the
sample's number. Either renderer turns it into a :class:`~mpsnet_core.synthesis.sample.Sample`, one file each.

The world's axes are the camera's: x right, y up, z towards the camera, which stands on the z axis and looks down it.
"""
