"""The verb design: search, sharpen, check; what limits are worth; smooth costs."""
