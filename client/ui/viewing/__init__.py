"""One viewer's scene and pictures, and the loop that draws them."""
