"""From the options of a command to the settings of its job, one module a command."""
