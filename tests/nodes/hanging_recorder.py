"""A recorder that never returns from destroying a subscription, and holds the global interpreter lock (GIL)."""

import ctypes

from rclpy.impl.implementation_singleton import rclpy_implementation
from tt_tools.record_node import main

rclpy_implementation.Subscription.destroy_when_not_in_use = lambda subscription: ctypes.PyDLL(None).sleep(1000)

if __name__ == "__main__":
    main()
