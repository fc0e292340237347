"""Leaves of several lobes, from one scan: files in, an asset a leaf out."""
