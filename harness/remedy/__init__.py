"""Stage *remedy*: what makes estimators bear that the vehicle is not as believed, tried on the runs of a study.

``choices`` says what is tried, ``run`` tries it, ``judge`` compares, ``report`` tells. Every remedy is a study of its
own.
"""
