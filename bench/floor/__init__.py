"""How near the kernels are to what this machine's arithmetic allows (``python -m bench.floor``)."""
