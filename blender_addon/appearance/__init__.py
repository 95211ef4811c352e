"""The look of an object: nodes of its materials, modifiers, displacement. Shared by several steps."""
