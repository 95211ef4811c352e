"""Processes beside the live window: the core, and Blenders that render a copy of the file."""
