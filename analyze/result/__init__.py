"""Result document (JSON): an estimate's numbers with units, intervals, warnings, verdict in words."""
