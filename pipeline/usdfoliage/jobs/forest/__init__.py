"""The job of forests: from rasters of a terrain to an asset."""
