"""The Result document: numbers of an estimate with units, intervals, warnings and a verdict in words."""
