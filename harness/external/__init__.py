"""Plants and estimators of other people: their descriptions, and the worker processes in which their code runs."""
