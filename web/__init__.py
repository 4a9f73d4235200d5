"""The page that people look at: robot, joints, calibration, laboratory and fleet in a browser.

A separate process beside the service: it reads the database, leaves requests there as every command does, and starts
commands for what takes long.  Nothing of the service imports this package.
"""
