"""The sixteen images of Westover (1989), drawn again."""
