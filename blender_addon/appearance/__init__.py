"""What an object looks like: the nodes of its materials, its modifiers, its displacement. Used by several steps."""
