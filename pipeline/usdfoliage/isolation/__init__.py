"""Which part of a captured cloud is the plant: what it stands on, its pot and what is behind it are left out."""
