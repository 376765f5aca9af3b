"""Parameters from recordings; one method per file, named by its stem. ``contract`` says what a method exports."""
