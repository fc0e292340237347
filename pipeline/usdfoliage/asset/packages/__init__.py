"""Whole assets: which layers, maps and shaders a folder holds, and what is in one that exists."""
