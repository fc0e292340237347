"""What photographs show of leaves: colours, an average texture, visibility, base and apex."""
