"""Single-lobed leaves: the Bezier surface of 21 parameters, its edits and its conversions."""
