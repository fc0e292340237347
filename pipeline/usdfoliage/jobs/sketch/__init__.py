"""The job of a tree out of one photograph."""
