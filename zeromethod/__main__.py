"""`python -m zeromethod` is the command `zeromethod`."""

from zeromethod.cli.main import main

main()
