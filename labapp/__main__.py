"""Run the command line: `python -m labapp` does the same as `labapp`."""

# Python has loaded these three before it runs a script. While it looks for any other module, signal
# included, Ctrl-C may get lost or be printed with a traceback.
import _signal  # type: ignore[import-not-found]
import os
import sys

_TOO_LITTLE = (
    b"there isn't enough memory: labapp needs about 40 MB to start, and 1000 MB of addresses for "
    b"most commands. Raise the limit (ulimit -v, ulimit -d), or close other programs.\n"
)


def main() -> None:
    """Run the command line; Ctrl-C ends it without a traceback from here on."""
    _signal.signal(_signal.SIGINT, _quit_before_imports)
    try:
        from labapp.common.command_end import begin_command, quit_on_interrupt

        begin_command(sys.argv)
        quit_on_interrupt()
        from labapp.cli import main as run_command
    except MemoryError:
        os.write(2, _TOO_LITTLE)
        os._exit(1)
    run_command()


def _quit_before_imports(number: int, frame: object) -> None:
    """End the command at once; what would print --json's document isn't imported yet."""
    try:
        if "--json" in sys.argv:
            os.write(1, b'{"error": "cancelled", "exit_code": 130}\n')
        os.write(2, b"cancelled\n")
    finally:
        os._exit(130)


if __name__ == "__main__":
    main()
