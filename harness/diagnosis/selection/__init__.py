"""Selection of effects: score tests, refits, acceptance on held-out drives, probabilities of hypotheses."""
