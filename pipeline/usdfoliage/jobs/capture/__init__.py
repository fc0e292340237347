"""The job of a capture: from photographs to depth maps and a cloud."""
