"""Checks of an asset: USD's validators, ours, NVIDIA's, and a studio's own rules."""
