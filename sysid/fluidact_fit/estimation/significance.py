"""How sure is sure: the levels of significance that decide wherever noise could be the reason."""

from __future__ import annotations

SEEN = 3.0  # standard errors that chance reaches once in 400 looks
CERTAIN = 4.0  # standard errors that are no chance, even where the largest of many is looked at
DECISIVE = 12.0  # twice the log-likelihood ratio that tells one value, or one law, from another
DECIDED = 10.0 * DECISIVE  # beyond all doubt, where the likelihood itself is only nearly right
