"""Standard test suites on the test track: each row of a standard's table is a drive, a requirement and a verdict."""
