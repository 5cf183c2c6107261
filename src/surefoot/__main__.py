"""``python -m surefoot`` is the command ``surefoot``."""

from surefoot.cli.main import main

main()
