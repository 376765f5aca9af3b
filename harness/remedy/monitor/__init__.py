"""A trust monitor for an estimator of a study: bounds by its false alarms per hour, detections counted by level.

``runs`` takes runs of the study through the monitor, ``bounds`` finds what it holds its statistics against, ``counts``
says how often it is right, ``sensors`` what could be seen with others, ``run`` has all of it, ``report`` tells it.
"""
