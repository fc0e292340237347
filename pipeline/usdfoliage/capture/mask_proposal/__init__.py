"""A mask of the plant, proposed from a photograph's colours."""
