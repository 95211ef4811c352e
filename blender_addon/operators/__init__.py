"""Shared by the operators: bad input becomes one sentence, and the core runs without blocking the window."""
