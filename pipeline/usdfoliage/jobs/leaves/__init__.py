"""The job of leaves: from posed photographs with depth to an asset."""
