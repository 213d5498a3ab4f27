"""What optics and electronics do to a picture, one effect a class; `registry` lists all of them.

Each effect says when it is present, what it changes at most at each of its levels, what it costs,
and what it adds to the recipe of a picture (`simulator.planning.Effect`). No effect renders
anything.
"""
