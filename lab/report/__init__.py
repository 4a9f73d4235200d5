"""The lab's report: one HTML file that holds all it shows, for a browser, a phone or a printer, without a network.

``write_report`` takes whatever the lab has found; sections appear only where their data are given.  Text is in
verdict.py and words.py, numbers in quantity.py, the look in assets/.
"""

from lostmotion.lab.report import notebook
from lostmotion.lab.report.page import write_report

__all__ = ["notebook", "write_report"]
