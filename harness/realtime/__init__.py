"""``harness realtime``: does each estimator of a study fit into the cycle of a controller?

``one_lane`` makes kernels for a single run, ``clock`` reads the time inside them, ``measure`` calls every estimator
once per cycle, ``report`` writes down what came out.
"""
