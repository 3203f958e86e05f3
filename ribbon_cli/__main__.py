"""`python -m ribbon_cli`, the same as `ribbon`."""

from ribbon_cli.cli.main import main

if __name__ == "__main__":
    main()
