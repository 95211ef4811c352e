"""Moving things: numbered photos or a video in, a normal map for every frame out.

``source`` and ``video`` give frames one at a time, ``run`` estimates them in order while others are read and written,
``smoothing`` takes noise out of them over time. Nothing here grows with the number of frames but their names.
"""
