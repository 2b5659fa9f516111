"""What a drive is about: the schema of scenario files and their loading."""
