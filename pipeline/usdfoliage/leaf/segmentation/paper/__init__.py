"""Leaves as the paper finds them: superpixels, affinity, templates, refinement."""
