"""Branches of a plant: from a cloud to an editable skeleton with radii, and to its surface."""
