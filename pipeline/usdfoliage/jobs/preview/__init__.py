"""Pictures and the interactive viewer, drawn in the preview interpreter."""
