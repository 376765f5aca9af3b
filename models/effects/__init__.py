"""Effects: one file each adds a physical effect to a port of a vehicle."""
