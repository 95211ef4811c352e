"""Step 1: the rig, and the calibration of real lights."""
