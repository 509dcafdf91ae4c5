"""What a process stands on: its streams, its signals, and the environment of the processes that it starts.

Loads nothing but Python's own library, so that the command answers at once and children can be started early.
"""
