"""From a cloud to a skeleton with radii: ground, roots, paths, axes, forks, sections."""
