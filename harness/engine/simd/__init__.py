"""Numbers of the kernels: lanes of a vector register, and dual numbers over them."""
