"""Background processes: the core, and Blenders that render a copy of the file."""
