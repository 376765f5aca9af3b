"""Which findings of the dissertation (Ziaukas 2023, chapter 5) survive what it does not publish.

What the dissertation leaves open becomes a box (``factors``); a Sobol sequence over it says how a study of every kind
of chapter 5 turns out at each point (``studies``, ``points``); ``evidence`` tests the findings of the campaign there and
compares with the published numbers, ``report`` tells which findings hold where, on what they hinge, and which point is
nearest to the dissertation.
"""
