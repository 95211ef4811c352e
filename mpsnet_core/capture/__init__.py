"""The capture: one photo as linear values, its mask and corrections; calibration of the lights."""
