"""The commands of `ros2`, such as `ros2 topic`, one module for each: its verbs, their arguments, and the functions that run them.

A module imports what a verb needs only when the verb runs, so that a short command does not wait for imports that it does not use.
"""
