"""The parts of an asset, one layer each: leaves, branches, crown, and what moves them."""
