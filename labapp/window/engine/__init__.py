"""The engine process: it owns the bench, and does what the window asks.

It reads commands from standard input and writes reports to standard output. When its
input closes, because the window closed or was killed, it leaves the bench safe and ends.
"""
