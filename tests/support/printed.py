"""What is printed, without the breaks of its lines."""


def unwrapped(printed):
    """Return the lines of a text, those of a wrapped sentence in one."""
    return str(printed).replace("\n  ", " ")
