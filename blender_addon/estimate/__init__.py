"""Step 3: the estimate."""
