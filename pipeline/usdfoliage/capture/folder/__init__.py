"""A capture folder: photographs, masks and depth maps, listed and read."""
