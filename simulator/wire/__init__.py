"""The cable between a driver and a simulated instrument: bytes, their pace and their faults."""
