"""Recordings from a file and a channel map onto one time base; recordings written."""
