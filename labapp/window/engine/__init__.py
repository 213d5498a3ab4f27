"""The process that owns the bench and carries out the window's commands.

Commands and reports travel over a line between the two processes. When the line closes, because the
window closed or was killed, the engine leaves the bench safe and ends; if that takes too long, the
engine is killed.
"""
