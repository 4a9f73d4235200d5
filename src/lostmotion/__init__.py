"""Condition monitoring of robot joints, and a laboratory for its physical model.

The folders of this package are links to the top level of the project: ``model`` (the physics), ``detector`` (windows
and scores), ``drivers`` (the outside world), ``daemon`` (the service and the command line) and ``lab`` (the model
against measurements).  Nothing is imported here, so that ``import lostmotion`` stays free of cost.
"""

__version__ = "0.1.0"
