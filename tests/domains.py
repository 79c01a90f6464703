"""A ROS domain for each test."""

import itertools
import os

NUMBERS = itertools.count(os.getpid())


def next_domain():
    """Return the next number to try, for `domain_id`.

    A test does not use the domain of the test before it: DDS knows the nodes that were killed there until their lease ends.
    """
    return next(NUMBERS) % 100 + 1
