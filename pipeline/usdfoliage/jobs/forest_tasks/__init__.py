"""A forest in tasks, as builds of plants are: planted by one, each tile written by one of its own."""
