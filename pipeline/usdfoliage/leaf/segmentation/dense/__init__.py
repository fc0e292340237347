"""Leaves out of dense foliage: surface patches, proposals, evidence, selection. Our own."""
