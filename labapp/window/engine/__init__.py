"""The engine process: it owns the bench, and does what the window asks.

Commands and reports go over the line to the window. When that closes, because the window
closed or was killed, it leaves the bench safe and ends, or is killed if it takes too long.
"""
