"""A ROS domain for each test."""

import itertools
import os

WORKER = int(os.environ.get("PYTEST_XDIST_WORKER", "gw0").removeprefix("gw"))
NUMBERS = itertools.count(os.getppid() + 33 * WORKER)  # workers, with the same parent, begin far apart


def next_domain():
    """Return the next number to try, for `domain_id`.

    A test does not use the domain of a test just before it: until their lease ends, DDS still lists the nodes that were killed there.
    """
    return next(NUMBERS) % 100 + 1
