"""Step 5: heights and displacement."""
