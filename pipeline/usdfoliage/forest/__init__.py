"""Forests: a terrain, the plants that stand on it, and how each is drawn."""
