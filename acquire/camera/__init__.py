"""GigE Vision cameras: interface, Aravis driver, stream that maps frame times to the host clock."""
