"""The pages of a build: a plant's report and a library's index, and their pictures."""
