"""What lives in Aravis' process.

With Python's standard library, gi and `drivers.hosted`, so that the system's Python can run it:
its modules know each other only by relative imports. Whoever started the process decides what
frames are good for; here is only what the library does.
"""
