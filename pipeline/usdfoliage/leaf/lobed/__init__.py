"""Leaves of several lobes, from one picture: silhouette, skeleton, railroad ties, and their deformation."""
