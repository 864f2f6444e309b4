"""Pages that lead on to another address: one by itself, which is never seen, and one by a person's click.

Unlike a redirection each is a page of its own origin, to which browsers hand strict cookies for what follows.
"""

from html import escape


def leading_page(url: str) -> str:
    """Its HTML."""
    on = escape(f"0;url={url}")
    return f'<!doctype html><meta charset="utf-8"><title>volsplat</title><meta http-equiv="refresh" content="{on}">\n'


def asking_page(line: str, url: str) -> str:
    """Its HTML: what a line tells, and a link there."""
    link = f'<a href="{escape(url)}">open it</a>'
    return f'<!doctype html><meta charset="utf-8"><title>volsplat</title><p>{escape(line)}: {link}</p>\n'
