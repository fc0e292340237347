"""The jobs of crowns: from a photograph, a capture or a cloud to an asset."""
