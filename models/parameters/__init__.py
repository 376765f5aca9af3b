"""Parameter sets: one file each, named author_year, with sources."""
