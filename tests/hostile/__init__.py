"""Files that are made to hang, fill or mislead whoever reads them, and what commands make of them.

Every maker takes a folder and gives the path of its file there. `CANARY` is a named pipe beside
them: a command that opens it to read never comes back.
"""
