"""The words of the ros2 command, one module for each: its verbs, their arguments, and what they call.

A module imports what a verb needs when the verb runs, so that a list of names does not wait for what reads bags.
"""
