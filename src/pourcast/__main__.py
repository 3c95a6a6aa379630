"""`python -m pourcast`."""

from pourcast.cli import main

main()
