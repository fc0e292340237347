"""Exports: an asset as other applications want it, in files that need nothing of ours."""
