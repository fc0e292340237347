"""From the points of a leaf to its 21 parameters and its place."""
