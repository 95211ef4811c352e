"""What goes wrong and is not a fault of the program."""


class InputError(Exception):
    """Bad input from outside. The message is one sentence: what is wrong, where, and how to mend it."""


class Cancelled(Exception):
    """The person asked to stop; nothing half-written is left behind."""
