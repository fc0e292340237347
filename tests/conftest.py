"""How property tests look for examples: the same ones every time, or, with HYPOTHESIS_PROFILE=explore, new ones."""

import os

from hypothesis import settings

# A loaded machine takes its time: how long an example takes says nothing.
settings.register_profile("same", derandomize=True, deadline=None)
settings.register_profile("explore", deadline=None)
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "same"))
