"""Branches that move: a rig, its sway, and stages of growth, with the leaves that follow."""
