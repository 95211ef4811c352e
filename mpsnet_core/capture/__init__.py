"""Captures: photos in linear values with masks and corrections; calibration of the lights."""
