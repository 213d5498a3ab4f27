"""The virtual bench behind its true wires: ports, a camera's packets and a screen's pixels.

`serving` is `labapp virtual-bench serve`; `shared_world` the one world behind all; `filters`,
`cameras`, `panels` and `spectroradiometers` what is before it; `command_input` and
`command_interpreter` what a person types meanwhile.
"""
