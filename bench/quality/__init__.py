"""How good the pictures are: against rays cast in float64, from many sides, and beside what they cost."""
