"""Errors of the command line."""

from tt_core.errors import TtError


class GraphError(TtError):
    """Something that is not in the graph, or not of the kind that was asked for."""
