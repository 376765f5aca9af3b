"""What a trace found: verdict, record, files, and what it gains an estimator and a study."""
