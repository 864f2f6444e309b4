"""The client: owns the scene, divides the volume, coordinates every server."""
