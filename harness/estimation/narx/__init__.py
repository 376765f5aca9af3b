"""A NARX network as an estimator: data, training, choice of delays and architecture (Ziaukas 2023, ch. 3 and 5.2)."""
