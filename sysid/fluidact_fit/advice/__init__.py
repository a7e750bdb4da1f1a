"""Advice on a log: families that fit it, parameters they would determine, commands to run.

Units say what a column can be, names what it is called, and a trial fit whether the log behaves so:
its verdict and its refusals are those of the fit itself. Where units and names do not say what
every column is, the candidates of each role are listed, with a command to complete.
"""

from .command import column_options as column_options
from .search import suggest as suggest
from .suggestion import Suggestion as Suggestion
from .suggestion import is_clear as is_clear
from .trial import views_of as views_of
from .undecided import unit_lines as unit_lines
