"""`python -m labapp` is `labapp`."""

from labapp.cli import main

if __name__ == "__main__":
    main()
