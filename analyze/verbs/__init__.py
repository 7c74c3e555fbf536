"""The verbs of `analyze`, by what they are of: options in, and over to the module that does the work."""
