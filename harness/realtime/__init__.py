"""``harness realtime``: does each estimator of a study fit into the cycle of a controller?

``clock`` reads the time inside kernels for a single run, ``measure`` calls every estimator once per cycle, ``report``
writes down what came out.
"""
