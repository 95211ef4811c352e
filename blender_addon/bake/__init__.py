"""Step 4: the bake, of one view and of many."""
