"""The same kernels on a graphics card: a lane is a thread there."""
