"""What optics and electronics do to a picture, most with a file of their own, in `registry` all of
them.

Each says when it is there, what it changes at most at each of its levels, what it costs, and what
it adds to the recipe of a picture: `simulator.planning.Effect`. None renders anything.
"""
