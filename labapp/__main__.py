"""Run the command line: `python -m labapp` does the same as `labapp`."""

import os
import sys


def main() -> None:
    """Run labapp's command line; Ctrl-C ends it without a traceback from here on."""
    try:
        from labapp.common.command_end import begin_command, quit_on_interrupt

        begin_command(sys.argv)
        quit_on_interrupt()
    except KeyboardInterrupt:
        os._exit(130)
    from labapp.cli import main as run_command

    run_command()


if __name__ == "__main__":
    main()
