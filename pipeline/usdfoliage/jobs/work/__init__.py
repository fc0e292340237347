"""Results that outlive a run, and settings files."""
