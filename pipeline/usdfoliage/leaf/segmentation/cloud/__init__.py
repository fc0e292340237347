"""Which points of a cloud are which leaf, by form alone: no photographs, no stations."""
