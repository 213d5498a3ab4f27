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
        # What would print the document isn't imported yet.
        if "--json" in sys.argv:
            os.write(1, b'{"error": "cancelled", "exit_code": 130}\n')
        os._exit(130)
    from labapp.cli import main as run_command

    run_command()


if __name__ == "__main__":
    main()
