"""A virtual bench served to real drivers through ports, camera packets and a screen's pixels.

`serving` implements `labapp virtual-bench serve`. `shared_world` is the virtual world of all
instruments. `filters`, `cameras`, `panels` and `spectroradiometers` serve the instruments.
`command_input` and `command_interpreter` handle the commands that a person types meanwhile.
"""
