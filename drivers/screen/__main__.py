"""`python -m drivers.screen`: list the screens, and show a label with its name on each."""

from __future__ import annotations

import argparse
import sys

from drivers.errors import DeviceError
from drivers.screen.identify import format_listing, list_screens, show_names


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m drivers.screen", description=__doc__)
    parser.add_argument("--display", help="the X server, such as :0; DISPLAY if it isn't given")
    parser.add_argument("--seconds", type=float, default=5.0, help="for which the names stand")
    asked = parser.parse_args()
    try:
        print(format_listing(list_screens(asked.display)), flush=True)
        show_names(asked.display, asked.seconds)
    except DeviceError as error:
        print(error, file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
