"""Findings of the dissertation (Ziaukas 2023, chapter 5) over the box of what it does not publish.

What the dissertation leaves open becomes a box (``factors``). A Sobol sequence over it says how the studies of
chapter 5 turn out at each point (``studies``, ``points``). ``evidence`` tests the findings of the campaign there and
compares with the published numbers; ``analysis`` says where findings hold and on what that hinges; ``search`` goes on
to the point nearest to the dissertation; ``report`` tells.
"""
