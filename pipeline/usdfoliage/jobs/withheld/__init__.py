"""Finished assets against photographs that they were not made of."""
