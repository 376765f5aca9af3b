"""What helps where a parameter is not as believed."""
