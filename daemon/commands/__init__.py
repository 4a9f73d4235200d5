"""The commands, a module each.  Options that several share are in options.py, those of the quick commands in cli.py."""
