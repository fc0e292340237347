"""Poses from photographs: pairs, reconstruction in a process of its own, diagnosis, world frame."""
