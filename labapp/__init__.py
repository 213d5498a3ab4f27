"""The laboratory application: files, acquisition, records, studies, command line and window."""

from importlib.metadata import version

__version__ = version("labapp")
