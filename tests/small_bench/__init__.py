"""The one small bench of all tests: photographed in milliseconds, in three forms.

`files` writes it as a user would, `setups` has it read already, and `world` is the simulator's
own view of it.
"""
