"""The sixteen images of Westover (1989), drawn again: what they show, of which volumes, and on which plates."""
