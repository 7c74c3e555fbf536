"""GigE Vision cameras: interface, Aravis driver, and the stream that maps frame times to the host clock."""
