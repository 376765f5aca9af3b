"""Content blocks, layout, colours and number formats of reports."""
