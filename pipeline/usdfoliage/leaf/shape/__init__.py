"""The leaf's algebra: curves, surface, meshes, patches, edits, measures."""
