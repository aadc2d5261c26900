"""The independent checker of saved runs.

It has code of its own from the track to the totals and imports nothing of auvplan but what names, opens and
hashes files, so that a fault of the planners or the simulator cannot hide itself here.
"""
