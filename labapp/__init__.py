"""The laboratory application: files, acquisition, records, studies, command line and window."""


def __getattr__(name: str) -> str:
    """Return the version when it is asked for: the command line begins without looking it up."""
    if name == "__version__":
        from importlib.metadata import version

        return version("labapp")
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
