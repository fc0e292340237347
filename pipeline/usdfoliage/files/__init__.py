"""Files as a pipeline needs them: whole or not there, hashed, locked; TOML and JSON that strangers wrote."""
