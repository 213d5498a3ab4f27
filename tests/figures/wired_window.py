"""`python wired_window.py FOLDER SEED`: a window at a wired bench, until somebody kills it.

It asks for runs as `window_victim` does, places the targets that it is asked for, and leaves an
engine that was killed alone. FOLDER/journal.jsonl gets a line for whatever the window has shown.
"""

from __future__ import annotations

import sys
from pathlib import Path

from figures.window_victim import Victim


class WiredWindow(Victim):
    """One window, with a person who confirms every target at once."""

    def _turn(self) -> None:
        if self._window.message.restart.isVisible():
            return
        if self._window.prompt_bar.is_asking:
            self._window.prompt_bar.done_button.click()
        super()._turn()


if __name__ == "__main__":
    victim = WiredWindow(Path(sys.argv[1]), int(sys.argv[2]))
    sys.exit(victim.application.exec())
