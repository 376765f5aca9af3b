"""Time of the kernels against the least that this machine's arithmetic allows (``python -m bench.floor``)."""
