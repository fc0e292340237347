"""The job of branches: from a cloud on disk to an asset."""
