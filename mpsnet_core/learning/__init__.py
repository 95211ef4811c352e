"""Learning: training of the networks, and evaluation of every model."""
