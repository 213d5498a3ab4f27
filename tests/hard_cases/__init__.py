"""Hard cases: a catalogue of what goes wrong in numerical optics, as a table that is a test.

Every row says what is asked, why that is hard, who judges the answer, and to which tolerance:

    Seen("Airy's pattern", "a jagged edge of the stop costs 2 %", View(LENS, FINE), by_airy)

`cd tests && python -m hard_cases` prints all of them; pytest tries all of them. The rows stand
by subject, in the files that catalogue.py lists; table.py and ways.py have the kinds of rows,
view.py what a PSF is asked with, judges/ the slow judges, which share nothing with the
library but the declared model, and test_judges.py holds those against each other. In every
row: accuracy or a clear error, in value and derivative, and no
NaN. A row with a `bug` is one that the library doesn't serve yet; it is expected to fail, and
pytest says so on the day it no longer does.
"""
