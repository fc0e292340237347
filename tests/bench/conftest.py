"""Benchmarks are scripts: their folder is where Python finds them."""

import sys
from pathlib import Path

TOOLS = Path(__file__).parents[2] / "tools"
sys.path += [str(TOOLS), str(TOOLS / "bench")]
