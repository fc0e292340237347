"""Depth from photographs with known poses: matching, agreement between views, upsampling."""
