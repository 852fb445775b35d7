"""From unlabelled demonstrations to movement primitives: segments, their clusters, frames, goals and forces (thesis 3).

`segmentation.py` cuts the signals of each entity, `task_spaces.py` shows the segments in every task space, a method assigns
them to primitives, and `result.py` is what all methods return.
"""
