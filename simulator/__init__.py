"""The virtual bench: scenes, effects, and devices that obey the physics in optics.

It knows optics and drivers, and not labapp; importing it loads nothing.
"""
