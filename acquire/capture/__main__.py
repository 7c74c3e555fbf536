"""`python -m acquire.capture --fd N --heartbeat N`: started by the daemon."""

from acquire.capture.process import main

main()
