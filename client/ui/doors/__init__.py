"""Who may see the page, and how they come to it."""
