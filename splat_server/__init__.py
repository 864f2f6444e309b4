"""The splat server: merges the batches of all map/shade servers, splats them, and publishes the image."""
