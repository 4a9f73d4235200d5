"""The lab's report: one self-contained HTML file for a browser, a phone or a printer, without a network.

``write_report`` takes any results of the lab; a section appears only where its data are given.  page.py composes the
sections: misfit.py has those of a comparison, fitted.py those of a fit, findings.py those of a search, signals.py the
zoomable plots.  Sentences are in verdict.py and words.py, numbers in quantity.py, the style in assets/.
"""

from lostmotion.lab.report import notebook
from lostmotion.lab.report.page import write_report

__all__ = ["notebook", "write_report"]
