"""What the commands do: one module each.  Arguments are cli.py's."""
