"""The interactive client: a page in the browser that shows the volume and every control of the scene."""
