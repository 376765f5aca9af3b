"""What the five documents publish, record by record, and what our results say of it: ``make reproduce``."""
