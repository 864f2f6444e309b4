"""The panel of servers below the picture: who did what in the last frame, over which links, and when."""
