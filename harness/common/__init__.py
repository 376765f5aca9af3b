"""Errors, files, units, statistics and registries of components, for all packages."""
