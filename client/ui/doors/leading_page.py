"""A page that is never seen: it leads on to another address.

Unlike a redirection it is a page of its own origin, to which browsers hand strict cookies for what follows.
"""

from html import escape


def leading_page(url: str) -> str:
    """Its HTML."""
    on = escape(f"0;url={url}")
    return f'<!doctype html><meta charset="utf-8"><title>volsplat</title><meta http-equiv="refresh" content="{on}">\n'
