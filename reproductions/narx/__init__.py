"""Training of the NARX network: data, Lipschitz indices, Levenberg-Marquardt, free-running refinement."""
