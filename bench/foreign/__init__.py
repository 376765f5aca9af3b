"""A plant of other hands: a tractor-semitrailer simulated apart from the project, its recordings traced and scored."""
