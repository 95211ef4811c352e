"""Where a newcomer begins: Try It."""
