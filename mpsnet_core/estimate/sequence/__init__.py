"""Sequences: a normal map for every frame of numbered photos or of a video.

``source`` and ``video`` provide frames one at a time. ``run`` estimates them in order while others are read and
written. ``smoothing`` removes noise over time. Memory does not grow with the number of frames, except for their names.
"""
