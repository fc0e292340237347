"""Clouds of depth maps: fusion, cleaning, and which cameras see which points."""
