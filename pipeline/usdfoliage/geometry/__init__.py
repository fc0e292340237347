"""The one home of mathematics that two domains share: cubemaps, polylines, frames, meshes."""
