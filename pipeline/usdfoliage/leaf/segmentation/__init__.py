"""Which points of a capture belong to which leaf."""
