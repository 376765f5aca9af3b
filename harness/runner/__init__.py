"""The loops over time that everything runs through: one of a filter, one of a vehicle, and what each keeps."""
