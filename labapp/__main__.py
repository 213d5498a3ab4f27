"""Run the command line: `python -m labapp` does the same as `labapp`."""

from labapp.cli import main

if __name__ == "__main__":
    main()
