"""Result document (JSON): numbers of an estimate with units, intervals, warnings and a verdict in words."""
