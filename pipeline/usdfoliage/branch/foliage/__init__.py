"""Leaves on the twigs of a skeleton, by the habits of a species."""
