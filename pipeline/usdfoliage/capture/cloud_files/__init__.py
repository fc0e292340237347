"""Point clouds on disk: PLY, LAS, text; their unit, up axis, spacing and false colours."""
