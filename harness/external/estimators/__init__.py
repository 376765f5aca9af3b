"""Estimators of other people in worker processes: Python classes, C libraries and networks.

A loader has ``kind`` and, of every kind,

``settings``                            table of the study, handed on
``inputs``, ``measurements``, ``estimates``
                                        names of the signals in the order of the arrays, ``None`` where not stated
``values``                              names of the numbers of the belief, in the order of the array
``variances``, ``nis``                  whether it gives them, ``None`` where not stated

A body fulfils ``harness.external.bodies.EstimatorBody`` and has ``declared()``: what it says of itself, as far as it
does. ``inputs``, ``measurements`` and ``estimates`` are names, or a table of units by name; ``sizes`` are how many of
each and of ``values`` there must be; ``variances`` and ``nis`` as above.
"""
