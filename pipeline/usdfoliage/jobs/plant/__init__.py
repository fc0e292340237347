"""A whole plant from one capture: which tasks there are, what each does, where it runs, and what was done already."""
