"""State estimators, their contract, and what may be said of a drive before estimating."""
