"""Channel maps proposed for files without one: columns by their names, their units and what their values do."""
