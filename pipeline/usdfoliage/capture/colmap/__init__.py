"""COLMAP's sparse models: cameras and poses, binary and text."""
