"""Looks: layers that edit the leaves of an asset wherever a scene refers to it."""
