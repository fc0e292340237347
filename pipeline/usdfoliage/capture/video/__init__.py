"""Videos: which of their frames are taken as photographs."""
