"""What usdview's package offers to plug-ins, for machines without usdview: the documented interface and no more.

Source: the tutorial "Creating a Usdview Plugin" of OpenUSD, and the docstrings of its Usdviewq.
"""
