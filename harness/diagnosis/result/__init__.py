"""Result of a trace: verdict, record, files, and the gain for an estimator and a study."""
