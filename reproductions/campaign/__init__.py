"""The campaign: the finished studies of the dissertation and the joint study, gathered into one report.

``results`` reads what the studies wrote, ``evidence`` turns pairs of groups of runs into ratios with intervals and
judges them, ``claims`` states what the dissertation found as tests on our data, ``report`` writes it down.
"""
