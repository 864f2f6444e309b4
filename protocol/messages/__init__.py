"""What the programs say to one another, who says it, and what may stand in it."""
