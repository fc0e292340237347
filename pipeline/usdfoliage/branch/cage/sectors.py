"""The rings of a branch cage have six vertices each; a sector is what lies between two neighbouring ones."""

import numpy as np

SIDES = 6
TURN = 2 * np.pi
