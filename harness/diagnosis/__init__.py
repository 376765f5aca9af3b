"""From what a model leaves unexplained to the effect it lacks: residual, pinpoint, trace, amend."""
