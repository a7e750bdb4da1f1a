"""Responses of a log without a model: impulse and step, frequency, correlation."""

from .impulse_response import ImpulseResponse as ImpulseResponse
from .impulse_response import impulse_response as impulse_response
from .impulse_response import respond_alike as respond_alike
from .spectra import CrossCorrelation as CrossCorrelation
from .spectra import FrequencyResponse as FrequencyResponse
from .spectra import cross_correlation as cross_correlation
from .spectra import frequency_response as frequency_response
from .views import Views as Views
from .views import view_fit as view_fit
from .views import view_runs as view_runs
