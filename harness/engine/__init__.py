"""From equations to compiled kernels over SIMD lanes."""
