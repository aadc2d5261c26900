"""`python -m auvplan.cli` is the command line."""

from auvplan.cli import main

if __name__ == "__main__":
    main()
