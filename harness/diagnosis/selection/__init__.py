"""Which effects are added: score tests, refits, acceptance on drives that were held out."""
