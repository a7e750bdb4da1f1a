"""Levels of significance, used wherever noise could be the explanation."""

from __future__ import annotations

SEEN = 3.0  # standard errors that chance exceeds once in 400 tests
CERTAIN = 4.0  # standard errors that are not chance, even for the largest of many
DECISIVE = 12.0  # twice the log-likelihood ratio that tells one value, or one law, from another
DECIDED = 10.0 * DECISIVE  # the same where the likelihood itself is only approximate
