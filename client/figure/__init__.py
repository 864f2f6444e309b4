"""Figures for papers: a finished picture with its scale, colours, sides and words, as pixels, SVG or PDF."""
