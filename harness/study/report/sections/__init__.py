"""The sections of a study's report, one file each; each turns an analysis into content blocks."""
