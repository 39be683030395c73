"""The command line `eskin`."""
