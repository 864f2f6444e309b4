"""A renderer written from docs/image.md alone, and what it must not know: anything of ours."""
