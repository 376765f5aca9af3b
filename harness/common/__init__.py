"""What every part may use: errors, files, units, statistics, and the folders that are registries."""
