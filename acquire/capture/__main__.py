"""Entry point of the capture process, started by the daemon.

`python -m acquire.capture --fd N --heartbeat N`, with the descriptors of the inherited socket and pipe.
"""

from acquire.capture.process import main

main()
