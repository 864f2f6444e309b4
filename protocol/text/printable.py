"""Texts that others wrote, made fit to be shown."""


def printable(text: str) -> str:
    """The text without what could steer a terminal or break a line."""
    return "".join(character if character.isprintable() else "?" for character in text)


def one_line(text: str) -> str:
    """As `printable`, the lines joined: what a library says may be several."""
    return printable(" ".join(text.split()))
