"""A study with a plant that nobody here wrote: the multi-body car of ``commonroad-vehicle-models``."""
