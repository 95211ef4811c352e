"""Step 2: the photo, rendered under the rig or opened."""
