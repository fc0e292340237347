"""The stages of a build: what each task does."""
