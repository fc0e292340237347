"""Materials of an asset, and the maps they read."""
