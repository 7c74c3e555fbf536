"""Entry point of `python -m analyze`: runs the `analyze` command."""

from analyze.cli import main

main()
