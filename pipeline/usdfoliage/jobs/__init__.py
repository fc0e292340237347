"""Which stages run, on which files, and what is reported of them."""
