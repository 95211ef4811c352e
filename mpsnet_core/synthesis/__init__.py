"""Training data: samples drawn from a seed, rendered by Blender's Cycles or by this package.

A :class:`~mpsnet_core.synthesis.scene_description.SceneDescription` is drawn from a seed and the sample's number.
Either renderer turns it into a :class:`~mpsnet_core.synthesis.sample.Sample`, one file each.

World axes are the camera's: x right, y up, z towards the camera, which is on the z axis and looks along -z.
"""
