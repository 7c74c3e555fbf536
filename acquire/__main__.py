"""`python -m acquire`."""

from acquire.cli import main

main()
