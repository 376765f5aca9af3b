"""The public objects of ``import harness`` (docs/api.md), one module each, imported when first asked for.

The command line is a thin layer over this. Nothing here computes: it turns what a user states into what the packages
below take, and what they return into xarray, pandas and objects that show themselves in a notebook.
"""
