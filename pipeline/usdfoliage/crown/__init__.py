"""A crown from one photograph: silhouette, surface, relief, texture, model."""
