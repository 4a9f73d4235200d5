"""The lab's report: one self-contained HTML file for a browser, a phone or a printer, without a network.

``write_report`` takes any results of the lab; sections appear only where their data are given.  Text is in verdict.py
and words.py, numbers in quantity.py, the look in assets/.
"""

from lostmotion.lab.report import notebook
from lostmotion.lab.report.page import write_report

__all__ = ["notebook", "write_report"]
