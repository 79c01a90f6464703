"""Errors of the `ros2` command line."""

from tt_core.errors import TtError


class GraphError(TtError):
    """Error: the command line names a node, a topic or a field of a message that does not exist, or that has not the expected type."""
