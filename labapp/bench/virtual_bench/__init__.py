"""The virtual bench behind its true wires: ports, a camera's packets and a screen's pixels.

`serving` is `labapp virtual-bench serve`; `shared` the one world behind all; `filters`,
`cameras`, `panels` and `spectroradiometers` what is before it; `talking` what a person types
meanwhile.
"""
