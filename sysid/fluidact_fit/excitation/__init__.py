"""What to record next: the excitation that best determines the least certain parameter.

    M = J' J / sigma^2,   std_error = sqrt(diag(M^-1))

``J`` is the derivative of the output by the parameters at the values of a parameter file,
``sigma`` the rmse of its fit. Candidates of several shapes within the stated limits are
simulated, the best by Fisher's information [1]_ are improved one number at a time. The
prediction is as good as the file: it takes the values, the white noise and the model of
the file as true.

References
----------
.. [1] G. Goodwin, R. Payne, Dynamic System Identification: Experiment Design and Data
   Analysis, 1977, chapter 6.
"""

from __future__ import annotations

from .designing import design
from .result import Candidate, Design, Forecast, Limits

__all__ = ["Candidate", "Design", "Forecast", "Limits", "design"]
