"""The picture in the page, and what the page and the server say about it."""
