"""`python -m aoprecalc`."""

from aoprecalc.cli import main

if __name__ == "__main__":
    main()
