"""Models in, USD out: the only package that writes USD structure and imports pxr."""
