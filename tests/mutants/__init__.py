"""Would a test notice? Small bugs are put into one module, and the tests that could see them run.

    make mutants MODULE=optics/plane.py
    PYTHONPATH=tests .venv/bin/python -m mutants optics/plane.py --count 20 --seed 1

A mutant is the module with one change: a comparison turned round, a sign, a constant, an argument
left out, a statement deleted. It's killed when a test fails, and survives when none does. What
survives is either no bug at all (a tolerance, a faster way to the same value) or one that nobody
would notice: write the test that does.

`changes` makes the mutants, `related` finds the test files by their imports, `reached` sees which
of them come to which line, `running` runs them in forks of one process that has loaded the
libraries, `report` prints. The files in the checkout stay as they are: `overlay` hands the changed
text to Python's import, in child processes as well.
"""
