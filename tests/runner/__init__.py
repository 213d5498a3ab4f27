"""How the tests are run: two at a time, each within its limit, and what they cost.

`units` says which tests belong together, `schedule` hands them to the workers, `limits` ends what
hangs, `processes` leaves no process behind, `costs` measures, `budget` says what
all may cost, `report` prints.
"""
