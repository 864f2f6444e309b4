"""A renderer written from docs/how_it_works/image.md alone, and what it must not know: anything of ours."""
