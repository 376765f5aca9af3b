"""From what a model leaves unexplained to the effect it lacks: innovations, selection, residuals, result."""
