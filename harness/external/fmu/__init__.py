"""Plants and estimators that are FMUs: FMI 2.0 and 3.0, co-simulation and model exchange."""
