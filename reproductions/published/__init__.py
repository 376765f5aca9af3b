"""Published numbers of the five documents, record by record, with our verdict on each: ``make reproduce``."""
