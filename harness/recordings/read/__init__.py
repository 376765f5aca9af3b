"""Recordings from a file and a channel map onto one time base; channel maps proposed; recordings written."""
