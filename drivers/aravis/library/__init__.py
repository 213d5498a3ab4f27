"""What runs in the child process: control of a camera, its features and its frame stream.

The code needs only Python's standard library, gi and `drivers.hosted`, so that the system's
Python can run it; its modules import each other relatively for the same reason. It only passes on
what the library does; the parent process decides which frames are accepted.
"""
