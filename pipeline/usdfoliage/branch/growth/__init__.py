"""Branches that grow: buds, importance, hidden interiors, variations of a plant."""
