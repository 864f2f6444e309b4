"""Renderers written from docs/how_it_works/image.md and slab_image.md alone, which know nothing of ours."""
