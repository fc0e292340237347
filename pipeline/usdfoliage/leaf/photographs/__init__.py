"""What photographs say of leaves: colours, an average texture, visibility, base and apex."""
