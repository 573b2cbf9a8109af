"""Escape untrusted text for a terminal, a log or an error message.

Keys and names may contain any Unicode: escape sequences that recolour, move the cursor or retitle a window, line breaks
that forge a line, marks that reverse the direction of reading.
"""


def printable(text: str, keep: str = "") -> str:
    r"""Return a text with every character that does not print as Python writes it, such as ``\x1b``.

    keep : characters to leave as they are: a line break, where lines are meant
    """
    if text.isprintable():
        return text
    return "".join(c if c.isprintable() or c in keep else repr(c)[1:-1] for c in text)
