"""A virtual bench served to real drivers through ports, camera packets and a screen's pixels.

`serving` implements `labapp virtual-bench serve`. `shared_world` is the virtual world of all
instruments. `instruments`, `filters`, `cameras` and `panels` serve the instruments.
`command_interpreter` handles the commands that a person types meanwhile.
"""
