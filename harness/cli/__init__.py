"""The command line: one file per command. Nothing else knows typer, and nothing else prints."""
