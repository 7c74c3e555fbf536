"""Entry point of `python -m acquire`, which is the same as the command `acquire`."""

from acquire.cli import main

main()
