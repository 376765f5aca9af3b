"""Speed against peers and against the targets: ``make bench``."""
