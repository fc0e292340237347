"""Exports of finished assets for other applications."""
