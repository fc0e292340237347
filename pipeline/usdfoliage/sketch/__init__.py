"""A tree out of one photograph and a few strokes."""
