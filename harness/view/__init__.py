"""A finished study as a local web page: from a box to the run behind it (``harness view``)."""
