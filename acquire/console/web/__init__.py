"""Operator's web console: a web server that is one more client of the daemon's socket."""
