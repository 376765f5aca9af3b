"""The same estimation problem through other libraries, in one run with ours; ``make bench PEERS=1``."""
